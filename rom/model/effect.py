"""What an added effect is: a force or body effect, a change of the tension law, a reading, a sensor's fault.

All four carry a name, the place where they enter, an equation for people, and parameters; what differs is the
function behind them and to what it is applied.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar, Literal, Protocol, Self, TypeVar

import numpy as np
import numpy.typing as npt

from rom.criteria.number import Numerical
from rom.model.laws import Parameter

_WIDER: Numerical[float] = 10.0  # end of a range that a value was found beyond, over that value

FloatArray = npt.NDArray[np.float64]
Numbers = tuple[float, ...]
Kind = Literal["force", "law change", "reading", "sensor fault"]


class TakesEffects(Protocol):
    """What an effect can be added to: a model."""

    def with_effect(self, effect: ModelCorrection) -> Self:
        """The same with one more effect."""
        ...


M = TypeVar("M", bound=TakesEffects)


@dataclass(frozen=True)
class ModelCorrection:
    """Name, place, equation and parameters: what all added effects share.

    Parameters
    ----------
    name : str
        Name of the catalogue, or ``"free-form"``.
    enters : str
        A link, ``"body:<name>"`` (motion relative to ground), ``"tension"`` (the bolted link) or
        ``"sensor:<channel>"``.
    equation : str
        The equation for people.
    parameters : mapping of str to Parameter
        In the order of the function's parameter array.

    Attributes
    ----------
    kind : {"force", "law change", "reading", "sensor fault"}
        What the effect acts on.
    """

    kind: ClassVar[Kind]
    name: str
    enters: str
    equation: str
    parameters: Mapping[str, Parameter]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "parameters": dict(self.parameters)}  # a mapping proxy does not pickle

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        ModelCorrection.__post_init__(self)

    @property
    def values(self) -> FloatArray:
        """Parameter values in order, shape (parameters,)."""
        return np.array([parameter.value for parameter in self.parameters.values()], dtype=np.float64)

    @property
    def _numbers(self) -> Numbers:
        return tuple(parameter.value for parameter in self.parameters.values())

    @property
    def place(self) -> str:
        """Kind of place: link, body, tension or sensor."""
        kind = self.enters.partition(":")[0]
        return kind if kind in ("body", "tension", "sensor") else "link"

    @property
    def path(self) -> str:
        """Where a model that holds the effect has its parameters: ``"<enters>.<name>"``."""
        return f"{self.enters}.{self.name}"

    def added_to(self, model: M) -> M:
        """The model with this effect; its parameters are below ``path``."""
        return model.with_effect(self)

    def with_values(self, **values: float) -> Self:
        """The same effect with other parameter values; their old limits no longer hold and are dropped.

        Raises
        ------
        ValueError
            If a name is not a parameter of the effect or a value is outside its bounds.
        """
        unknown = sorted(set(values) - set(self.parameters))
        if unknown:
            known = ", ".join(self.parameters) or "none"
            raise ValueError(f"effect {self.name!r} has the parameters {known}, got {', '.join(unknown)}")
        changed = {
            name: replace(self.parameters[name], value=float(value), low=None, high=None)
            for name, value in values.items()
        }
        return replace(self, parameters={**self.parameters, **changed})

    def with_told_values(self, **values: float) -> Self:
        """The same with values that records tell without a search: a range that one is beyond is wider here.

        An accelerometer that shows gravity at rest has an offset beyond that of usual amplifiers.
        """
        changed = {}
        for name, value in values.items():
            number, (low, high) = self.parameters[name], self.parameters[name].bounds
            if not low < value < high:
                low, high = min(low, _WIDER * value), max(high, _WIDER * value)
            changed[name] = replace(number, value=float(value), low=None, high=None, bounds=(low, high))
        return replace(self, parameters={**self.parameters, **changed})


@dataclass(frozen=True)
class Effect(ModelCorrection):
    """A force in a link or on a body, compiled into the equations of motion.

    Parameters
    ----------
    function : callable
        ``f(t, x, v, T, k, c, s, p, ds, dT) -> force [N]`` added to the link's force, which pulls the first
        body back; ``k``, ``c`` the link's stiffness and damping at its tension, ``s``, ``p`` the states and
        parameters; the function fills the state rates ``ds`` and may set ``dT[0]`` [N/s], added to the
        tension's rate.
    states : int
        Number of internal states.
    starts : tuple of str
        What each state has at the start of a motion: "x", the displacement there, "v", the velocity, or "",
        zero; empty where all are zero.
    on_disk : bool
        Whether the compiled function may be cached on disk (it lives in a file).
    """

    kind = "force"
    function: Callable[..., float] = field(repr=False)
    states: int = 0
    starts: tuple[str, ...] = ()
    on_disk: bool = field(default=True, repr=False)

    @property
    def address(self) -> int:
        """Address of the compiled function; compiles on first use."""
        from rom.kernels.function_addresses import address_of

        return address_of(self.function, "effect", self.on_disk)

    def first_states(self, displacement: float, velocity: float) -> FloatArray:
        """States at the start of a motion, (states,).

        Parameters
        ----------
        displacement, velocity : float
            Of its place at the start [m], [m/s].
        """
        known = {"x": displacement, "v": velocity, "": 0.0}
        return np.array([known[one] for one in self.starts or ("",) * self.states], dtype=np.float64)


@dataclass(frozen=True)
class Motion:
    """Motion of one record as it was simulated or measured, at the samples of its tension.

    Parameters
    ----------
    time : ndarray
        Time [s] from the record's first sample, shape (samples,).
    impact_s : float
        Time of the impact [s].
    displacement : ndarray
        Relative displacement of the bolted link [m].
    link_force : ndarray
        Force of the bolted link [N]; only readings that follow it need it.
    body_displacement : mapping of str to ndarray
        Displacement by body [m]; only readings that follow a body need it.
    """

    time: FloatArray
    impact_s: float
    displacement: FloatArray
    link_force: FloatArray = field(default_factory=lambda: np.zeros(0))
    body_displacement: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True)
class Reading(ModelCorrection):
    """What a bolt's gauge shows beyond the tension of the model: ``T_measured = T + reading(motion)``.

    It leaves motion and tension alone: what a simulation is compared with a gauge by.

    Parameters
    ----------
    reading : callable
        ``f(motion, p) -> [N]``, with the shape of the motion's time.
    """

    kind = "reading"
    reading: Callable[[Motion, Numbers], FloatArray] = field(repr=False)

    def added(self, motion: Motion) -> FloatArray:
        """What the reading adds to the tension [N]."""
        return self.reading(motion, self._numbers)

    def at_rest(self, time: FloatArray) -> FloatArray:
        """What the reading adds while nothing moves [N], at times [s] from the first sample."""
        still = np.zeros_like(time)
        return self.added(Motion(time, 0.0, still, still, {"": still}))

    def apply(self, tension: npt.ArrayLike, motion: Motion) -> FloatArray:
        """The reading [N] of a simulated tension."""
        return np.asarray(tension, dtype=np.float64) + self.added(motion)

    def remove(self, measured: npt.ArrayLike, motion: Motion) -> FloatArray:
        """The tension [N] behind a measured reading; inverse of ``apply`` for the same motion."""
        return np.asarray(measured, dtype=np.float64) - self.added(motion)


Samples = Callable[..., FloatArray]


@dataclass(frozen=True)
class SensorFault(ModelCorrection):
    """A fault of one channel, corrected in processing and never modelled as force.

    Parameters
    ----------
    fault, cure : callable
        ``f(samples, rate_hz, p) -> samples``: from what is true to what the channel shows, and back; with
        the samples of another channel as fourth argument where ``other`` names one.
    other : str
        Kind of channel that disturbs this one: its quantity, on another body; empty for none.
    """

    kind = "sensor fault"
    fault: Samples = field(repr=False)
    cure: Samples = field(repr=False)
    other: str = ""

    @property
    def channel(self) -> str:
        """The channel, such as ``"acceleration_so"``."""
        return self.enters.partition(":")[2]

    def apply(self, samples: npt.ArrayLike, rate_hz: float, other: npt.ArrayLike | None = None) -> FloatArray:
        """What the channel shows of true ``samples``, shape (samples,); ``other`` are those that disturb it.

        Parameters
        ----------
        samples : ndarray, shape (..., samples)
            Samples.
        rate_hz : float
            Sampling rate [Hz].
        other : array, shape (samples,)
            Samples of the channel that disturbs this one, where there is one.

        Returns
        -------
        ndarray
            Shape (samples,).

        Raises
        ------
        ValueError
            If the fault needs samples of another channel and none are given.
        """
        return self._run(self.fault, samples, rate_hz, other)

    def remove(
        self, samples: npt.ArrayLike, rate_hz: float, other: npt.ArrayLike | None = None
    ) -> FloatArray:
        """The true signal behind shown ``samples``; inverse of ``apply`` but for what the fault destroys.

        Parameters
        ----------
        samples : ndarray, shape (..., samples)
            Samples.
        rate_hz : float
            Sampling rate [Hz].
        other : array, shape (samples,)
            Samples of the channel that disturbs this one, where there is one.

        Returns
        -------
        ndarray
            Shape (samples,).
        """
        return self._run(self.cure, samples, rate_hz, other)

    def _run(
        self, function: Samples, samples: npt.ArrayLike, rate_hz: float, other: npt.ArrayLike | None
    ) -> FloatArray:
        given = np.asarray(samples, dtype=np.float64)
        if not self.other:
            return function(given, rate_hz, self._numbers)
        if other is None:
            raise ValueError(
                f"{self.name} in {self.channel} needs the {self.other} of another body, got none"
            )
        return function(given, rate_hz, self._numbers, np.asarray(other, dtype=np.float64))
