"""A record's output and its derivatives at the lines of its spectra, whitened, line by line.

`rom.identification.spectral_model` gives the equations. At a hundred lines of two bodies array expressions
spend their time on being called.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.function_addresses import ALLOCATES_NOTHING, INNER


@njit(**INNER)  # type: ignore[untyped-decorator]
def _whiten(whitener: Any, line: int, value: Any, column: int, out: Any) -> None:
    """Real parts of S^-1/2 times one column of values (lines, bodies, columns), imaginary ones below."""
    lines, n = whitener.shape[0], whitener.shape[1]
    for i in range(n):
        total = 0j
        for j in range(n):
            total += whitener[line, i, j] * value[line, j, column]
        out[line * n + i, column] = total.real
        out[(lines + line) * n + i, column] = total.imag


@njit(nogil=True, **ALLOCATES_NOTHING)  # type: ignore[untyped-decorator]
def receptances(s: Any, mass: Any, damping: Any, stiffness: Any, out: Any) -> bool:
    """Fill (s^2 M + s C + K)^-1 of one body or two, (lines, bodies, bodies); whether all have an inverse.

    Parameters
    ----------
    s : ndarray of complex, shape (lines,)
        2 pi i f [rad/s].
    mass, damping, stiffness : ndarray, shape (bodies, bodies)
        M, C and K.
    out : ndarray of complex, shape (lines, bodies, bodies)
        Filled.
    """
    one = mass.shape[0] == 1
    for line in range(s.size):
        at = s[line]
        first = at * (at * mass[0, 0] + damping[0, 0]) + stiffness[0, 0]
        if one:
            if first == 0:
                return False
            out[line, 0, 0] = 1.0 / first
            continue
        right = at * (at * mass[0, 1] + damping[0, 1]) + stiffness[0, 1]
        left = at * (at * mass[1, 0] + damping[1, 0]) + stiffness[1, 0]
        second = at * (at * mass[1, 1] + damping[1, 1]) + stiffness[1, 1]
        determinant = first * second - right * left
        if determinant == 0:
            return False
        share = 1.0 / determinant
        out[line, 0, 0], out[line, 0, 1] = second * share, -right * share
        out[line, 1, 0], out[line, 1, 1] = -left * share, first * share
    return True


@njit(nogil=True, **ALLOCATES_NOTHING)  # type: ignore[untyped-decorator]
def _answer(gain: Any, root: Any, line: int, k: int) -> Any:
    """Column k of G Q^1/2 at a line, of the first channel and of the second, where there is one."""
    above, below = 0j, 0j
    for j in range(gain.shape[2]):
        above += gain[line, 0, j] * root[line, j, k]
        if gain.shape[1] == 2:
            below += gain[line, 1, j] * root[line, j, k]
    return above, below


@njit(nogil=True, **ALLOCATES_NOTHING)  # type: ignore[untyped-decorator]
def whiteners(gain: Any, root: Any, sensor: Any, out: Any) -> bool:
    """Fill the inverse triangular roots of G Q G^H + R of one channel or two; whether all have one.

    Parameters
    ----------
    gain : ndarray of complex, shape (lines, channels, forces)
        G.
    root : ndarray of complex, shape (lines, forces, forces)
        Of Q.
    sensor : ndarray, shape (channels,)
        Diagonal of R.
    out : ndarray of complex, shape (lines, channels, channels)
        Filled.
    """
    forces = gain.shape[2]
    for line in range(gain.shape[0]):
        first, second, across, apart = 0.0, 0.0, 0j, 0.0
        for k in range(forces):
            above, below = _answer(gain, root, line, k)
            first += above.real**2 + above.imag**2
            second += below.real**2 + below.imag**2
            across += below * above.conjugate()
            for j in range(k):
                other_above, other_below = _answer(gain, root, line, j)
                wedge = above * other_below - other_above * below
                apart += wedge.real**2 + wedge.imag**2
        whole = first + sensor[0]
        if whole <= 0:
            return False
        out[line, 0, 0] = 1.0 / np.sqrt(whole)
        if gain.shape[1] == 1:
            continue
        # |b|^2 - |b a*|^2 / (|a|^2 + R_1) by Lagrange's identity: a difference would be lost to rounding
        left = sensor[1] + (sensor[0] * second + apart) / whole
        if left <= 0:
            return False
        out[line, 0, 1], out[line, 1, 0] = 0.0, -across / (whole * np.sqrt(left))
        out[line, 1, 1] = 1.0 / np.sqrt(left)
    return True


@njit(nogil=True, **ALLOCATES_NOTHING)  # type: ignore[untyped-decorator]
def outputs(  # noqa: C901, PLR0912 - one flat pass over the lines
    s: Any, mass: Any, damping: Any, sampled: Any, corner: float, orders: Any, receptance: Any, force: Any,
    force_errors: Any, sampling_errors: Any, whitener: Any, gain: Any, forced: Any, ends: Any, columns: Any,
) -> None:  # fmt: skip
    """Fill the gain, the forced output and the columns of the end states and of the force's errors.

    Parameters
    ----------
    s : ndarray of complex, shape (lines,)
        2 pi i f [rad/s].
    mass, damping : ndarray, shape (bodies, bodies)
        M and C.
    sampled : ndarray, shape (2, 2, bodies, bodies)
        Derivatives of the channels' order, and of one more, of motion that gains one in velocity, and in
        displacement, times what sums over samples weigh them with: ``a + s b``, a and b.
    corner : float
        Of the accelerometers' AC coupling [rad/s].
    orders : ndarray of int, shape (bodies,)
        Order of the derivative that a body's channel shows.
    receptance : ndarray of complex, shape (lines, bodies, bodies)
        Z^-1.
    force : ndarray of complex, shape (lines, bodies)
        Spectra of the forces.
    force_errors : ndarray of complex, shape (lines, bodies, errors)
        Spectra that the hammer's noise adds.
    sampling_errors : ndarray, shape (2,)
        Standard errors of the force's gain and delay.
    whitener : ndarray of complex, shape (lines, bodies, bodies)
        S^-1/2.
    gain : ndarray of complex, shape (lines, bodies, bodies)
        Filled: from forces to channels.
    forced : ndarray of complex, shape (lines, bodies)
        Filled: the output without end states.
    ends : ndarray of complex, shape (lines, bodies, columns)
        Filled: of velocity, displacement, accelerometers, the hammer's errors, gain and delay.
    columns : ndarray, shape (2 lines bodies, columns)
        Filled: the same, whitened.
    """
    n, errors = orders.size, force_errors.shape[2]
    sensors = 0
    for i in range(n):
        sensors += orders[i] == 2
    for line in range(s.size):
        at, sensor = s[line], 2 * n
        sinking = 1.0 / (at + corner)
        for i in range(n):
            accelerates = orders[i] == 2
            coupling = at * sinking if accelerates else 1.0 + 0j
            shown = coupling
            for _ in range(orders[i]):
                shown *= at
            answer = 0j
            for j in range(n):
                gain[line, i, j] = shown * receptance[line, i, j]
                answer += gain[line, i, j] * force[line, j]
            forced[line, i] = answer
            for k in range(n):
                by_mass, by_damping = 0j, 0j
                for j in range(n):
                    by_mass += gain[line, i, j] * mass[j, k]
                    by_damping += gain[line, i, j] * damping[j, k]
                of_v = sampled[0, 0, i, k] + at * sampled[0, 1, i, k]
                of_x = sampled[1, 0, i, k] + at * sampled[1, 1, i, k]
                ends[line, i, k] = -by_mass - coupling * of_v
                ends[line, i, n + k] = -at * by_mass - by_damping - coupling * of_x
            if orders[i] == 2:
                ends[line, i, i] += coupling
            if orders[i] >= 1:
                ends[line, i, n + i] += coupling * (at if accelerates else 1.0)
            for k in range(2 * n, 2 * n + sensors):
                ends[line, i, k] = 0.0
            if accelerates:
                ends[line, i, sensor] = sinking
                sensor += 1
            first = 2 * n + sensors
            for k in range(errors):
                total = 0j
                for j in range(n):
                    total += gain[line, i, j] * force_errors[line, j, k]
                ends[line, i, first + k] = total
            aliased = answer - (coupling * force[line, i] / mass[i, i] if accelerates else 0.0)
            ends[line, i, first + errors] = aliased * sampling_errors[0]
            ends[line, i, first + errors + 1] = at * aliased * sampling_errors[1]
        for k in range(ends.shape[2]):
            _whiten(whitener, line, ends, k, columns)


@njit(nogil=True, **ALLOCATES_NOTHING)  # type: ignore[untyped-decorator]
def derivatives(  # noqa: C901, PLR0912 - one flat pass over the lines
    s: Any, mass: Any, damping: Any, corner: float, orders: Any, receptance: Any, gain: Any, force: Any,
    modelled: Any, states: Any, directions: Any, powers: Any, weights: Any, whitener: Any, space: Any,
    changes: Any, jacobian: Any,
) -> None:  # fmt: skip
    """Fill the derivatives of the output by terms, end states held, and the same whitened.

    Parameters
    ----------
    s : ndarray of complex, shape (lines,)
        2 pi i f [rad/s].
    mass, damping : ndarray, shape (bodies, bodies)
        M and C.
    corner : float
        Of the accelerometers' AC coupling [rad/s].
    orders : ndarray of int, shape (bodies,)
        Order of the derivative that a body's channel shows.
    receptance, gain : ndarray of complex, shape (lines, bodies, bodies)
        Z^-1, and from forces to channels.
    force, modelled : ndarray of complex, shape (lines, bodies)
        Spectra of the forces, and of the output with its end states.
    states : ndarray, shape (columns,)
        Of the record's end, gains in velocity and displacement first.
    directions : ndarray, shape (terms, bodies)
        Along which a coefficient acts.
    powers : ndarray of int, shape (terms,)
        Of s that it carries in Z; -1: the corner.
    weights : ndarray, shape (terms,)
        Step in which each is counted.
    whitener : ndarray of complex, shape (lines, bodies, bodies)
        S^-1/2.
    space : ndarray of complex, shape (2, bodies)
        Overwritten.
    changes : ndarray of complex, shape (lines, bodies, terms)
        Filled.
    jacobian : ndarray, shape (2 lines bodies or more, terms)
        Its first rows are filled.
    """
    n = orders.size
    total, motion = space[0], space[1]
    for line in range(s.size):
        at = s[line]
        sinking = 1.0 / (at + corner)
        for j in range(n):
            total[j] = force[line, j]
            for i in range(n):
                by_v, by_x = states[i], states[n + i]
                total[j] -= by_v * mass[i, j] + at * by_x * mass[i, j] + by_x * damping[i, j]
        for i in range(n):
            motion[i] = 0.0
            for j in range(n):
                motion[i] += receptance[line, i, j] * total[j]
        for term in range(powers.size):
            power, along = powers[term], 0j
            for j in range(n):
                moved = motion[j]
                if power > 0:
                    moved = at * moved + states[n + j]
                if power > 1:
                    moved = at * moved + states[j]
                along += moved * directions[term, j]
            for i in range(n):
                change = 0j
                if power >= 0:
                    for j in range(n):
                        change -= gain[line, i, j] * directions[term, j] * along
                elif orders[i] == 2:
                    change = -modelled[line, i] * sinking
                changes[line, i, term] = change * weights[term]
            _whiten(whitener, line, changes, term, jacobian)
