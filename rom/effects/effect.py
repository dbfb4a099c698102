"""An added effect: a compiled function with parameters and states, at a link, a body or the tension."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from rom.laws import Parameter


@dataclass(frozen=True)
class Effect:
    """An effect: name, place, equation, parameters, states and function.

    Parameters
    ----------
    name : str
        Name of the catalogue, or ``"free-form"``.
    enters : str
        A link, ``"body:<name>"`` (motion relative to ground) or ``"tension"`` (the bolted link).
    equation : str
        The equation for people.
    parameters : mapping of str to Parameter
        In the order of the function's parameter array.
    function : callable
        ``f(t, x, v, T, k, c, s, p, ds, dT) -> force [N]`` added to the link's force, which pulls the first
        body back; ``s``, ``p`` the states and parameters; the function fills the state rates ``ds`` and may
        set ``dT[0]`` [N/s], added to the tension's rate.
    states : int
        Number of internal states, zero at the start.
    on_disk : bool
        Whether the compiled function may be cached on disk (it lives in a file).
    """

    name: str
    enters: str
    equation: str
    parameters: Mapping[str, Parameter]
    function: Callable[..., float] = field(repr=False)
    states: int = 0
    on_disk: bool = field(default=True, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    @property
    def values(self) -> npt.NDArray[np.float64]:
        """Parameter values in order, shape (parameters,)."""
        return np.array([parameter.value for parameter in self.parameters.values()], dtype=np.float64)

    @property
    def address(self) -> int:
        """Address of the compiled function; compiles on first use."""
        from rom.kernels.calling import address_of

        return address_of(self.function, "effect", self.on_disk)

    def with_values(self, **values: float) -> Effect:
        """The same effect with other parameter values."""
        changed = {
            name: replace(self.parameters[name], value=float(value), low=None, high=None)
            for name, value in values.items()
        }
        return replace(self, parameters={**self.parameters, **changed})
