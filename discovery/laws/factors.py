"""Factors of tension laws: functions of the motion, and functions of the tension, with inner parameters.

A term of a law is a coefficient times one motion factor times one tension factor. Each factor is one text,
which people read and which is compiled, and the powers of base quantities that fix its unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.model.laws import Parameter, Place, free_form_law

_USUAL_N: Numerical[tuple[float, float]] = (20.0, 500.0)  # grids then reach past all preloads
_BASE_UNITS = {
    "v": {"m": 1.0, "s": -1.0},
    "x": {"m": 1.0},
    "F": {"N": 1.0},
    "P": {"N": 1.0, "m": 1.0, "s": -1.0},
    "T": {"N": 1.0},
}


@dataclass(frozen=True)
class Inner:
    """A number inside a factor: value, range, unit, whether a fit may move it, and grid for a search."""

    value: float
    low: float
    high: float
    unit: str
    free: bool = True
    grid: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not self.low <= self.value <= self.high:
            raise ValueError(f"inner parameter must lie within [{self.low}, {self.high}], got {self.value}")

    @property
    def step(self) -> float:
        """Step of the grid on which exposures are kept: a quarter of an exponent, a share of a threshold."""
        return 0.25 if self.unit == "1" else self.high / 32


@dataclass(frozen=True)
class Factor:
    """A function of the motion (``x v F D``) or of the tension (``T``).

    Attributes
    ----------
    text : str
        Expression of ``rom.model.expressions``.
    inner : mapping of str to Inner
        Its parameters by name.
    powers : tuple of (base, power)
        Base quantities v, x, F, P (power), T and their powers, each a number or the name of an inner
        parameter: the factor's unit.
    """

    text: str
    inner: Mapping[str, Inner] = field(default_factory=dict)
    powers: tuple[tuple[str, str | float], ...] = ()

    @property
    def key(self) -> tuple[str, tuple[float, ...]]:
        """Text and inner values: equal keys mean equal functions."""
        return self.text, tuple(inner.value for inner in self.inner.values())

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Inner parameters as parameters of a law."""
        return {
            name: Parameter(inner.value, inner.unit, bounds=(inner.low, inner.high))
            for name, inner in self.inner.items()
        }

    @property
    def dimension(self) -> dict[str, float]:
        """Exponents of m, s and N."""
        found = {"m": 0.0, "s": 0.0, "N": 0.0}
        for base, power in self.powers:
            exponent = self.inner[power].value if isinstance(power, str) else power
            for unit, share in _BASE_UNITS[base].items():
                found[unit] += exponent * share
        return found

    def with_values(self, **values: float) -> Factor:
        """The same factor with other inner values, cut to their ranges."""
        if not values:
            return self
        inner = dict(self.inner)
        for name, value in values.items():
            old = inner[name]
            inner[name] = replace(old, value=float(min(max(value, old.low), old.high)))
        return replace(self, inner=inner)

    def at_node(self, name: str, value: float) -> Factor:
        """The same factor with one inner value, outside its range too: a node of a grid."""
        old = self.inner[name]
        node = replace(old, value=value, low=min(old.low, value), high=max(old.high, value))
        return replace(self, inner={**self.inner, name: node})

    def held(self, **values: float) -> Factor:
        """The same factor with these inner values fixed: no fit moves them."""
        changed = self.with_values(**values)
        return replace(
            changed,
            inner={name: replace(i, free=i.free and name not in values) for name, i in changed.inner.items()},
        )

    def of_motion(self, x: FloatArray, v: FloatArray, F: FloatArray, D: FloatArray) -> FloatArray:
        """Evaluate a motion factor at relative displacement [m], velocity [m/s], force and damping [N].

        Parameters
        ----------
        x, v : ndarray, shape (samples,)
            Relative displacement [m] and velocity [m/s] of the link.
        F, D : ndarray, shape (samples,)
            Its force and the damping's part of it [N].

        Returns
        -------
        ndarray, shape (samples,)
            The factor, in the unit of `dimension`.
        """
        return self._evaluated("tension rate", np.zeros_like(x), x, v, F, D)

    @property
    def address(self) -> int:
        """Address of a tension factor's compiled function ``f(T, p)``."""
        return _address(self.text, tuple(self.inner), "stiffness")

    def of_tension(self, tension: FloatArray) -> FloatArray:
        """Evaluate a tension factor at tensions [N]."""
        return self._evaluated("stiffness", tension)

    def _evaluated(self, enters: Place, *arguments: FloatArray) -> FloatArray:
        """Evaluate at arguments of one shape; a fit does so thousands of times, without a law each time."""
        from rom.kernels.evaluation import evaluate

        values = np.array([inner.value for inner in self.inner.values()], dtype=np.float64)
        table = np.stack([np.asarray(argument, dtype=np.float64).ravel() for argument in arguments])
        found = evaluate(_address(self.text, tuple(self.inner), enters), table, values)
        return np.asarray(found).reshape(np.shape(arguments[0]))


@cache
def _address(text: str, names: tuple[str, ...], enters: Place) -> int:
    any_value = {name: Parameter(1.0, "1") for name in names}
    return free_form_law("factor", text, enters, any_value).address


def _power(name: str, value: float, grid: tuple[float, ...], *, high: float = 8.0) -> dict[str, Inner]:
    return {name: Inner(value, 0.25, high, "1", grid=grid)}


_EXPONENTS: Numerical[tuple[float, ...]] = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0)


def velocity_power(n: float = 4.0) -> Factor:
    """``|v|^n``; n = 4 in He et al. (2025), Eq. 12."""
    return Factor("abs(v) ** n", _power("n", n, _EXPONENTS), (("v", "n"),))


def displacement_power(q: float = 2.0) -> Factor:
    """``|x|^q``: loosening driven by displacement."""
    return Factor("abs(x) ** q", _power("q", q, (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)), (("x", "q"),))


def velocity_displacement(n: float = 2.0, q: float = 1.0) -> Factor:
    """``|v|^n |x|^q``; rate-free for n = 1: then only the path counts."""
    inner = _power("n", n, (1.0, 2.0, 3.0)) | _power("q", q, (1.0, 2.0, 3.0))
    return Factor("abs(v) ** n * abs(x) ** q", inner, (("v", "n"), ("x", "q")))


def dissipated_power(m: float = 1.0) -> Factor:
    """``|c_C v^2|^m``: power that the joint's damping turns into heat."""
    return Factor("abs(D * v) ** m", _power("m", m, (0.5, 1.0, 1.5, 2.0), high=4.0), (("P", "m"),))


def force_power(m: float = 4.0) -> Factor:
    """``|F|^m``: loosening driven by the force in the link."""
    return Factor("abs(F) ** m", _power("m", m, (1.0, 2.0, 3.0, 4.0, 6.0)), (("F", "m"),))


def velocity_threshold(v_th: float, highest: float, n: float = 4.0) -> Factor:
    """``max(|v| - v_th, 0)^n``: nothing happens below a velocity; ``highest`` [m/s] bounds v_th.

    Parameters
    ----------
    v_th : float
        The velocity [m/s].
    highest : float
        Upper bound of v_th [m/s]; shares of it are the grid.
    n : float
        The exponent.

    Returns
    -------
    Factor
        With v_th and n as inner parameters.
    """
    grid = tuple(highest * share for share in (0.1, 0.2, 0.3, 0.45, 0.6))
    inner = {"v_th": Inner(v_th, 0.0, highest, "m/s", grid=grid)} | _power("n", n, (1.0, 2.0, 3.0, 4.0))
    return Factor("max(abs(v) - v_th, 0) ** n", inner, (("v", "n"),))


def displacement_threshold(x_th: float, highest: float, q: float = 2.0) -> Factor:
    """``max(|x| - x_th, 0)^q``: nothing happens below a displacement; ``highest`` [m] bounds x_th.

    Parameters
    ----------
    x_th : float
        The displacement [m].
    highest : float
        Upper bound of x_th [m]; shares of it are the grid.
    q : float
        The exponent.

    Returns
    -------
    Factor
        With x_th and q as inner parameters.
    """
    grid = tuple(highest * share for share in (0.1, 0.2, 0.3, 0.45, 0.6))
    inner = {"x_th": Inner(x_th, 0.0, highest, "m", grid=grid)} | _power("q", q, (1.0, 2.0, 4.0))
    return Factor("max(abs(x) - x_th, 0) ** q", inner, (("x", "q"),))


def tension_power(r: float = 1.0, *, free: bool = False) -> Factor:
    """``T^r``; proportional to the tension for r = 1."""
    if not free and r == 1.0:
        return Factor("max(T, 0)", {}, (("T", 1.0),))
    inner = {"r": Inner(r, 0.0, 3.0, "1", free=free, grid=(0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0))}
    return Factor("max(T, 0) ** r", inner, (("T", "r"),))


def usual_unit(tension: float) -> float:
    """Return the power of ten [N] in which a tension [N] is that of a usual bolt: 1 from 20 to 500 N."""
    low, high = _USUAL_N
    return 1.0 if low <= tension <= high else float(10.0 ** round(math.log10(max(tension, 1e-300) / 100.0)))


def tension_exponential(T_s: float = 300.0, unit: float = 1.0) -> Factor:
    """``T exp(-T / T_s)``: loosening fades above the tension T_s [N]; range and grid are in ``unit`` [N]."""
    grid = tuple(unit * T for T in (10.0, 30.0, 100.0, 200.0, 300.0, 500.0, 1000.0, 2000.0))
    inner = {"T_s": Inner(T_s, unit, 1e5 * unit, "N", grid=grid)}
    return Factor("max(T, 0) * exp(-max(T, 0) / T_s)", inner, (("T", 1.0),))


def tension_logistic(gamma_i: float = 8.0, rho: float = -0.0036, unit: float = 1.0) -> Factor:
    """``T 10^(-gamma_i / (1 + exp(rho T)))``: the shape of He et al. (2025), Eq. 13.

    Parameters
    ----------
    gamma_i : float
        Decades by which the rate falls, twice.
    rho : float
        Rate of the logistic [1/N].
    unit : float
        Tension [N] in which the range and the grid of rho are.
    """
    grid = tuple(value / unit for value in (-0.02, -0.007, -0.0025, -0.001))
    inner = {
        "gamma_i": Inner(gamma_i, -20.0, 40.0, "1", grid=(2.0, 4.5, 7.0, 11.0)),
        "rho": Inner(rho, -0.1 / unit, -1e-5 / unit, "1/N", grid=grid),
    }
    return Factor("max(T, 0) * 10 ** (-gamma_i / (1 + exp(rho * max(T, 0))))", inner, (("T", 1.0),))
