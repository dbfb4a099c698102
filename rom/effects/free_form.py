"""An effect found without the catalogue, from an arithmetic expression alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np

from rom.campaign.channels import FloatArray
from rom.model.effect import Effect, ModelCorrection
from rom.model.expressions import compile_expression
from rom.model.law_change import LawChange
from rom.model.laws import Parameter

FREE_FORM = "free-form"
_ARGUMENTS = ("t", "x", "v", "T", "k", "c")
_OF_RATE = ("T", "x", "v", "F", "D", "rate", "follow")


class FreeForm(Effect):
    """An effect whose function is made from its equation."""

    def along(self, motion: FloatArray) -> FloatArray:
        """Force [N] along a motion from the equation itself, (samples,): a trial is not compiled.

        ``motion`` has the rows x, v, T, k, c; the time counts from its first sample and is not used.
        """
        force = compile_expression(self.equation, _ARGUMENTS, tuple(self.parameters), arrays=True)
        with np.errstate(all="ignore"):
            found = force(0.0, *motion, self.values)
        return np.broadcast_to(np.asarray(found, dtype=np.float64), motion.shape[1:])

    def __reduce__(self) -> tuple[object, ...]:
        return free_form, (self.equation, self.enters, dict(self.parameters))  # its function does not pickle


def free_form(equation: str, enters: str, parameters: Mapping[str, Parameter]) -> ModelCorrection:
    """A force [N], or where it enters the tension a changed rate [N/s], from an expression.

    Parameters
    ----------
    equation : str
        In ``t x v T k c`` of its link or body and the parameters; of a tension as for ``LawChange``, in
        ``rate follow T x v F D``.
    enters : str
        A link, ``"body:<name>"`` or ``"tension"``.
    parameters : mapping of str to Parameter
        The parameters of the expression.

    Raises
    ------
    ValueError
        If the expression holds anything else.
    """
    if enters == "tension":
        compile_expression(equation, _OF_RATE, tuple(parameters))  # refuses what is not arithmetic
        return LawChange(FREE_FORM, enters, equation, parameters)
    kernel = _kernel(equation, tuple(parameters))
    return FreeForm(FREE_FORM, enters, equation, parameters, kernel, on_disk=False)


@cache
def _kernel(equation: str, parameters: tuple[str, ...]) -> Callable[..., float]:
    from numba import njit

    force = njit(error_model="numpy")(compile_expression(equation, _ARGUMENTS, parameters))

    def effect(t, x, v, T, k, c, s, p, ds, dT):  # type: ignore[no-untyped-def] # noqa: ARG001
        return force(t, x, v, T, k, c, p)

    return effect
