"""Delays between force and motions of a hit, told by the balance of momentum."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import integrate, optimize

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.criteria.suspicions import Suspicions
from rom.signals.damage import white_noise

_BEGUN: Numerical[float] = 0.05  # share of the largest motion with which it has begun
_COARSE: Numerical[float] = 0.7  # of a misfit that a delay near the right one leaves
TREND: Numerical[int] = 3  # order of the polynomial that offsets and slow motion leave in displacements


@dataclass(frozen=True, eq=False)
class Delay:
    """Samples by which motions at some places are late, what is left of the misfit then, and the products."""

    samples: float
    misfit: float
    places: tuple[int, ...]
    root: FloatArray


@dataclass(frozen=True, eq=False)
class Window:
    """The part of a record in which momentum is balanced.

    Attributes
    ----------
    force : ndarray, shape (samples,)
        Of the hammer, the whole record [N].
    rows : sequence of ndarray, shape (samples,)
        Motion of each body, the whole record.
    between : tuple of int
        First sample of the window, and the one behind its last.
    order, orders : int, sequence of int
        How often force and each motion are integrated.
    grounded : sequence of bool
        Whether each body is tied to the ground.
    noise : ndarray, shape (1 + n,)
        Squares of white noise of force and accelerations in the window.
    step : int
        Samples by which a contact may be late and hardly look otherwise.
    """

    force: FloatArray
    rows: Sequence[FloatArray]
    between: tuple[int, int]
    order: int
    orders: Sequence[int]
    rate_hz: float
    grounded: Sequence[bool]
    noise: FloatArray
    step: int
    rules: Suspicions

    def root(self, lag: int = 0, places: Collection[int] = ()) -> FloatArray:
        """Products with the motions at some places taken a lag later."""
        first, last = self.between
        cut = [
            row[first + lag : last + lag] if place in places else row[first:last]
            for place, row in enumerate(self.rows)
        ]
        return products(self.force[first:last], cut, self.order, self.orders, self.rate_hz)

    def delay(self, reach: int, onset: int, usual: float) -> Delay:
        """Return the delay of all motions, or of one, that balances best.

        Parameters
        ----------
        reach : int
            Samples about no delay, and about where motion begins, in which it is looked for.
        onset : int
            Samples from the force to the first motion.
        usual : float
            Samples by which sensors may be late.
        """
        root, rules = self.root(), self.rules
        every, near = tuple(range(len(self.rows))), range(-reach, reach + 1)
        masses, left = free_masses(root, self.grounded)
        noise = noise_share(root, self.noise, masses)
        found = Delay(0.0, 1.0, every, root)
        if left > rules.unbalanced:
            best = self._best(every, [*near, *(onset + lag for lag in near)], left, noise)
            if abs(best.samples) < usual or self._explains(best, left, noise, rules.slip_share):
                found = best
        least = self._least(noise)
        if len(every) < 2 or left - noise < least:
            return found
        alone = min((self._alone(place, near, left, noise) for place in every), key=lambda one: one.misfit)
        # at the end of what is looked at no delay balances best
        late = rules.late_alone * usual < abs(alone.samples) < reach - self.step
        told = late and self._explains(alone, left, noise, rules.late_share)
        better = (found.misfit - alone.misfit) * left > least
        return alone if told and better else found

    def _alone(self, place: int, lags: range, left: float, noise: float) -> Delay:
        """Return the best delay of one motion: coarsely first, since sound records have none."""
        coarse = self._best((place,), lags[:: self.step], left, noise)
        if coarse.misfit > _COARSE:
            return coarse
        middle = round(coarse.samples)
        return self._best((place,), range(middle - self.step, middle + self.step + 1), left, noise)

    def _best(self, places: tuple[int, ...], lags: Collection[int], left: float, noise: float = 0.0) -> Delay:
        """Return the delay that leaves least beyond noise."""
        first, last = self.between
        most = min(map(len, self.rows))
        inside = [lag for lag in lags if first + lag >= 0 and last + lag <= most]
        if not inside:
            return Delay(0.0, 1.0, places, self.root())
        roots = {lag: self.root(lag, places) for lag in inside}
        misfits = {lag: free_masses(root, self.grounded)[1] for lag, root in roots.items()}
        best = min(misfits, key=misfits.__getitem__)
        share = max(misfits[best] - noise, 0.0) / max(left - noise, 1e-300)
        return Delay(_between(misfits, best), share, places, roots[best])

    def _explains(self, found: Delay, left: float, noise: float, most: float) -> bool:
        """Whether a delay leaves little: less than any other sign, which is right half a period later.

        Where both leave noise alone, a force's sign is likelier than a delay of all motions; one motion
        balances with either sign where its body is light.
        """
        count = len(self.rows)
        margin = self._least(noise) if len(found.places) == count else 0.0
        turned = min(self._turned(places) for places in (range(count), *((i,) for i in range(count)))) - noise
        return found.misfit <= most and found.misfit * (left - noise) < max(turned - margin, 0.0)

    def _turned(self, places: Collection[int]) -> float:
        """Return what is left with the signs of motions at some places turned."""
        root, count = self.root(), len(self.rows)
        signs = np.ones(root.shape[1])
        signs[[1 + part * count + place for place in places for part in range(3)]] = -1.0
        return free_masses(root * signs, self.grounded)[1]

    def _least(self, noise: float) -> float:
        """Misfit that is more than noise and faults of sensors leave by chance."""
        return max(self.rules.late_left, self.rules.slip_noise * noise)


def begins(row: FloatArray) -> int:
    """Sample at which a motion begins."""
    height = np.abs(row - np.median(row))
    return int(np.argmax(height > max(_BEGUN * float(height.max()), 8 * white_noise(row))))


def noise_share(root: FloatArray, noise: FloatArray, masses: FloatArray) -> float:
    """Return what white noise of the channels leaves of the force, as a share of its square.

    Parameters
    ----------
    root : ndarray, shape (1 + 3 n, 1 + 3 n)
        Of the products of force and motions.
    noise : ndarray, shape (1 + n,)
        Squares of white noise in the columns of force and accelerations.
    masses : ndarray, shape (n,)
        Of each body [kg].
    """
    left = noise[0] + masses**2 @ noise[1:]
    return float(left / max(root[:, 0] @ root[:, 0], 1e-300))


def _between(left: Mapping[int, float], best: int) -> float:
    """Return where a parabola through the misfits around the best whole lag has its lowest point."""
    if not {best - 1, best + 1} <= left.keys():
        return float(best)
    before, at, after = (left[best + step] for step in (-1, 0, 1))
    return best + 0.5 * (before - after) / max(before - 2 * at + after, 1e-300)


def products(
    force: FloatArray, rows: Sequence[FloatArray], order: int, orders: Sequence[int], rate_hz: float
) -> FloatArray:
    """Return the triangular root of the products of force, accelerations, velocities, displacements.

    Parameters
    ----------
    force : ndarray, shape (samples,)
        Of the hammer [N].
    rows : sequence of ndarray, shape (samples,)
        Motion of each body.
    order : int
        How often force is integrated: as often as the measured motion is an integral of acceleration.
    orders : sequence of int
        How often each motion is integrated to be of that order.
    rate_hz : float
        Of sampling.
    """
    rows = [_integrated(row - row[0], times, rate_hz) for row, times in zip(rows, orders, strict=True)]
    accelerations = np.stack(rows, axis=1)
    velocities = _integrated(accelerations, 1, rate_hz)
    displacements = _integrated(velocities, 1, rate_hz)
    pushed = _integrated(force, order, rate_hz)[:, None]
    columns = np.concatenate([pushed, accelerations, velocities, displacements], axis=1)
    basis = _trend(len(columns), TREND + order)
    return np.asarray(np.linalg.qr(columns - basis @ (basis.T @ columns), mode="r"))


@lru_cache(maxsize=16)
def _trend(samples: int, order: int) -> FloatArray:
    """Return an orthonormal basis of polynomials, (samples, 1 + order)."""
    return np.linalg.qr(np.polynomial.polynomial.polyvander(np.linspace(-1, 1, samples), order))[0]


def _integrated(samples: FloatArray, times: int, rate_hz: float) -> FloatArray:
    for _ in range(times):
        samples = integrate.cumulative_trapezoid(samples, dx=1 / rate_hz, axis=0, initial=0)
    return samples


def ties_of(root: FloatArray, grounded: Sequence[bool], signs: FloatArray) -> FloatArray:
    """Return columns of velocity and displacement of what is tied to the ground.

    Parameters
    ----------
    root : ndarray, shape (1 + 3 n, 1 + 3 n)
        Of the products of force and motions.
    grounded : sequence of bool, shape (n,)
        Whether each body is tied to the ground.
    signs : ndarray, shape (n,)
        Minus one for a channel of the wrong sign.
    """
    count = len(grounded)
    tied = [place for place, is_tied in enumerate(grounded) if is_tied]
    return np.hstack([root[:, [1 + part * count + i for i in tied]] * signs[tied] for part in (1, 2)])


def free_masses(root: FloatArray, grounded: Sequence[bool]) -> tuple[FloatArray, float]:
    """Return masses none of which is below zero, and what they leave of the force's square."""
    count = len(grounded)
    ties = ties_of(root, grounded, np.ones(count))
    found, left = least(np.hstack([root[:, 1 : 1 + count], ties]), root[:, 0])
    return found[:count], left**2 / max(float(root[:, 0] @ root[:, 0]), 1e-300)


def least(columns: FloatArray, rest: FloatArray) -> tuple[FloatArray, float]:
    """Return the coefficients, none below zero, that leave least of the rest, and the norm of that."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    found, left = optimize.nnls(columns / scale, rest)
    return np.asarray(found / scale), float(left)
