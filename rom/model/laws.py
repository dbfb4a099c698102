"""Link laws and tension laws: one small frozen object each, with its compiled function.

A law's ``equation`` is an expression in the tension ``T`` [N], the relative displacement ``x`` [m] and
velocity ``v`` [m/s] of its link, the link force ``F`` and its damping part ``D`` [N], and the parameters by
name. Stiffness and damping laws depend on ``T`` alone. A joint without tension stays without: laws see
``max(T, 0)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Place = Literal["stiffness", "damping", "tension rate"]
Array = Sequence[float]

_UNLIMITED = (-math.inf, math.inf)
_LN10 = 2.302585092994046


Z95 = 1.959964
"""Half the width of 95 % limits, in standard errors."""


@dataclass(frozen=True)
class Parameter:
    """A number with its unit, its 95 % limits where known, the range it may take, and its source.

    Raises
    ------
    ValueError
        If the value is not a number within ``bounds``.
    """

    value: float
    unit: str
    low: float | None = None
    high: float | None = None
    bounds: tuple[float, float] = _UNLIMITED
    source: str = ""

    def __post_init__(self) -> None:
        low, high = self.bounds
        if not (math.isfinite(self.value) and low <= self.value <= high):
            raise ValueError(f"parameter must lie within [{low}, {high}] {self.unit}, got {self.value!r}")

    @property
    def at_bound(self) -> bool:
        """Whether a fit ended at an end of the range."""
        return (self.low, self.high) != (None, None) and self.value in self.bounds

    @property
    def limits(self) -> tuple[float | None, float | None]:
        """95 % limits; None where unknown, and on the side of a bound that a fit ended at."""
        low, high = self.bounds
        return None if self.value == low else self.low, None if self.value == high else self.high


@dataclass(frozen=True)
class Law:
    """A law of a link: name, equation, place, parameters and function.

    Parameters
    ----------
    name : str
        Name by which result files know the law.
    equation : str
        The expression that the function computes, as people and ``free_form_law`` read it.
    enters : {"stiffness", "damping", "tension rate"}
        Where the law enters: [N/m], [N s/m] or [N/s].
    parameters : mapping of str to Parameter
        In the order of the function's parameter array.
    function : callable
        ``f(T, p)`` for stiffness and damping, ``f(T, x, v, F, D, p)`` for the tension rate.
    on_disk : bool
        Whether the compiled function may be cached on disk (it lives in a file).
    """

    name: str
    equation: str
    enters: Place
    parameters: Mapping[str, Parameter]
    function: Callable[..., float] = field(repr=False)
    on_disk: bool = field(default=True, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    def __reduce__(self) -> tuple[object, ...]:
        # A mapping proxy and a generated function do not pickle; the name and the equation do.
        return law_from_text, (self.name, self.equation, self.enters, dict(self.parameters))

    @property
    def values(self) -> FloatArray:
        """Parameter values in order, shape (parameters,)."""
        return np.array([parameter.value for parameter in self.parameters.values()], dtype=np.float64)

    @property
    def sees_tension(self) -> bool:
        """Whether the law can depend on the tension."""
        return self.function is not _constant

    @property
    def address(self) -> int:
        """Address of the compiled function; compiles on first use."""
        from rom.kernels.function_addresses import address_of  # numba is loaded when something is computed

        return address_of(self.function, self.enters, self.on_disk)

    def with_values(self, **values: float) -> Law:
        """The same law with other parameter values; their old limits no longer hold and are dropped.

        Raises
        ------
        ValueError
            If a name is not a parameter of the law or a value is outside its bounds.
        """
        unknown = sorted(set(values) - set(self.parameters))
        if unknown:
            known = ", ".join(self.parameters) or "none"
            raise ValueError(f"law {self.name!r} has the parameters {known}, got {', '.join(unknown)}")
        changed = {
            name: replace(self.parameters[name], value=float(value), low=None, high=None)
            for name, value in values.items()
        }
        return replace(self, parameters={**self.parameters, **changed})

    def sourced(self, *sources: str) -> Law:
        """The same law with the source of every parameter, in order."""
        pairs = zip(self.parameters.items(), sources, strict=True)
        return replace(self, parameters={name: replace(p, source=text) for (name, p), text in pairs})

    def __call__(self, tension: npt.ArrayLike) -> FloatArray:
        """Evaluate a stiffness or damping law at tensions [N]; result in the tension's shape."""
        if self.enters == "tension rate":
            raise ValueError(f"law {self.name!r} needs the motion too: use rate(tension, x, v, F, D)")
        return self._evaluate(tension)

    def rate(
        self,
        tension: npt.ArrayLike,
        displacement: npt.ArrayLike,
        velocity: npt.ArrayLike,
        force: npt.ArrayLike = 0.0,
        damping_force: npt.ArrayLike = 0.0,
    ) -> FloatArray:
        """Evaluate a tension law [N/s]; arguments broadcast against each other.

        Parameters
        ----------
        tension : array
            Tension [N].
        displacement : array
            Relative displacement [m].
        velocity : array
            Relative velocity [m/s].
        force : array
            Force of the link [N].
        damping_force : array
            Damping part of the link's force [N].

        Returns
        -------
        ndarray
            Rate [N/s], in the broadcast shape.
        """
        if self.enters != "tension rate":
            raise ValueError(f"law {self.name!r} enters as {self.enters}: call it with the tension alone")
        return self._evaluate(tension, displacement, velocity, force, damping_force)

    def _evaluate(self, *arguments: npt.ArrayLike) -> FloatArray:
        from rom.kernels.evaluation import evaluate

        if len(arguments) == 1:  # of the tension alone, as laws are asked most often
            shape = np.shape(arguments[0])
            table = np.array(arguments[0], dtype=np.float64, order="C").reshape(1, -1)
        else:
            columns = np.broadcast_arrays(*(np.asarray(one, dtype=np.float64) for one in arguments))
            shape = columns[0].shape
            table = np.concatenate([column.reshape(1, -1) for column in columns])
        return np.asarray(evaluate(self.address, table, self.values)).reshape(shape)


def _constant(T: float, p: Array) -> float:  # noqa: ARG001 - the signature of its place
    return p[0]


def _logistic_stiffness(T: float, p: Array) -> float:
    return p[0] / (1.0 + math.exp(p[1] * (max(T, 0.0) - p[2])))


def _logistic_damping(T: float, p: Array) -> float:
    return p[0] - p[1] / (1.0 + math.exp(p[2] * max(T, 0.0)))


def _no_loosening(T: float, x: float, v: float, F: float, D: float, p: Array) -> float:  # noqa: ARG001
    return 0.0


# the paper's fourth power goes without the cost of a general one
def _power_loosening(T: float, x: float, v: float, F: float, D: float, p: Array) -> float:  # noqa: ARG001
    power: float = v * v * v * v if p[1] == 4.0 else abs(v) ** p[1]
    return -p[0] * power * max(T, 0.0)


def _logistic_loosening(T: float, x: float, v: float, F: float, D: float, p: Array) -> float:  # noqa: ARG001
    tension = max(T, 0.0)
    gamma = math.exp(_LN10 * (p[0] - p[1] / (1.0 + math.exp(p[2] * tension))))
    power: float = v * v * v * v if p[3] == 4.0 else abs(v) ** p[3]
    return -gamma * power * tension


def constant_stiffness(k: float) -> Law:
    """``k``: a spring of constant stiffness [N/m]."""
    return Law("constant stiffness", "k", "stiffness", {"k": Parameter(k, "N/m")}, _constant)


def logistic_stiffness(k_i: float, alpha: float, beta: float) -> Law:
    """``k_i / (1 + exp(alpha (T - beta)))`` [N/m]: He et al. (2025), Eq. 5.

    Parameters
    ----------
    k_i : float
        Plateau [N/m].
    alpha : float
        Steepness [1/N]; negative for a joint that stiffens with tension.
    beta : float
        Tension of half the plateau [N].
    """
    parameters = {
        "k_i": Parameter(k_i, "N/m", bounds=(0.0, math.inf)),
        "alpha": Parameter(alpha, "1/N"),
        "beta": Parameter(beta, "N"),
    }
    equation = "k_i / (1 + exp(alpha * (max(T, 0) - beta)))"
    return Law("logistic stiffness", equation, "stiffness", parameters, _logistic_stiffness)


def constant_damping(c: float) -> Law:
    """``c``: a dashpot of constant damping [N s/m]."""
    return Law("constant damping", "c", "damping", {"c": Parameter(c, "N s/m")}, _constant)


def logistic_damping(c_d: float, c_i: float, eta: float) -> Law:
    """``c_d - c_i / (1 + exp(eta T))`` [N s/m]: He et al. (2025), Eq. 11.

    Parameters
    ----------
    c_d, c_i : float
        Upper value and depth [N s/m].
    eta : float
        Steepness [1/N]; negative for damping that falls with tension.
    """
    parameters = {
        "c_d": Parameter(c_d, "N s/m"),
        "c_i": Parameter(c_i, "N s/m"),
        "eta": Parameter(eta, "1/N"),
    }
    equation = "c_d - c_i / (1 + exp(eta * max(T, 0)))"
    return Law("logistic damping", equation, "damping", parameters, _logistic_damping)


def no_loosening() -> Law:
    """``0``: the tension stays as it is."""
    return Law("no loosening", "0", "tension rate", {}, _no_loosening)


def power_loosening(gamma: float, exponent: float = 4.0) -> Law:
    """``-gamma |v|^exponent T`` [N/s] with constant gamma: He et al. (2025), Eq. 12.

    Parameters
    ----------
    gamma : float
        Rate [s^(exponent-1)/m^exponent]; negative values tighten.
    exponent : float
        Power of the relative velocity [1], positive.
    """
    parameters = {
        "gamma": Parameter(gamma, "s^(exponent-1)/m^exponent"),
        "exponent": Parameter(exponent, "1", bounds=(0.0, math.inf)),
    }
    equation = "-gamma * abs(v) ** exponent * max(T, 0)"
    return Law("power loosening", equation, "tension rate", parameters, _power_loosening)


def logistic_loosening(gamma_d: float, gamma_i: float, rho: float, exponent: float = 4.0) -> Law:
    """``-10^(gamma_d - gamma_i / (1 + exp(rho T))) |v|^exponent T`` [N/s]: He et al. (2025), Eqs. 12-13.

    Parameters
    ----------
    gamma_d, gamma_i : float
        Decimal logarithm of the largest rate, and its depth [1].
    rho : float
        Steepness [1/N].
    exponent : float
        Power of the relative velocity [1], positive.
    """
    parameters = {
        "gamma_d": Parameter(gamma_d, "1"),
        "gamma_i": Parameter(gamma_i, "1"),
        "rho": Parameter(rho, "1/N"),
        "exponent": Parameter(exponent, "1", bounds=(0.0, math.inf)),
    }
    equation = "-10 ** (gamma_d - gamma_i / (1 + exp(rho * max(T, 0)))) * abs(v) ** exponent * max(T, 0)"
    return Law("logistic loosening", equation, "tension rate", parameters, _logistic_loosening)


QUARTIC = ("logistic loosening", "power loosening", "no loosening")
"""Names of the laws that an identification ends with: ``gamma(T) |v|^4 T``."""

_FUNCTIONS: Mapping[str, Callable[..., float]] = {
    "constant stiffness": _constant,
    "logistic stiffness": _logistic_stiffness,
    "constant damping": _constant,
    "logistic damping": _logistic_damping,
    "no loosening": _no_loosening,
    "power loosening": _power_loosening,
    "logistic loosening": _logistic_loosening,
}


def law_from_text(name: str, equation: str, enters: Place, parameters: Mapping[str, Parameter]) -> Law:
    """A law from what its file says: by name where the name is known, from the equation where not.

    Parameters
    ----------
    name : str
        Name of the law.
    equation : str
        The equation.
    enters : {"stiffness", "damping", "tension rate"}
        Where it enters.
    parameters : mapping of str to Parameter
        Parameters by name.

    Returns
    -------
    Law
        The law.
    """
    if name in _FUNCTIONS:
        return Law(name, equation, enters, parameters, _FUNCTIONS[name])
    return free_form_law(name, equation, enters, parameters)


def free_form_law(name: str, equation: str, enters: Place, parameters: Mapping[str, Parameter]) -> Law:
    """A law from an arithmetic expression alone, compiled in well under a second.

    Parameters
    ----------
    name : str
        Name of the law; not one of the laws of this module.
    equation : str
        Expression in ``T x v F D`` and the parameters: ``+ - * / **``, and ``exp log sqrt tanh abs sign
        min max``.
    enters : {"stiffness", "damping", "tension rate"}
        Where the law enters.
    parameters : mapping of str to Parameter
        The parameters of the expression.

    Raises
    ------
    ValueError
        If the expression holds anything else.
    """
    from rom.model.expressions import compile_expression, is_on_disk

    arguments = ("T", "x", "v", "F", "D") if enters == "tension rate" else ("T",)
    function = compile_expression(equation, arguments, tuple(parameters))
    return Law(name, equation, enters, parameters, function, on_disk=is_on_disk(function))
