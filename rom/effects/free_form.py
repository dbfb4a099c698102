"""A force found without the catalogue, from an arithmetic expression alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache

from rom.effects.effect import Effect
from rom.expressions import compile_expression
from rom.laws import Parameter

FREE_FORM = "free-form"
_ARGUMENTS = ("t", "x", "v", "T", "k", "c")


class FreeForm(Effect):
    """An effect whose function is made from its equation."""

    def __reduce__(self) -> tuple[object, ...]:
        return free_form, (self.equation, self.enters, dict(self.parameters))  # its function does not pickle


def free_form(equation: str, enters: str, parameters: Mapping[str, Parameter]) -> Effect:
    """A force [N] from an expression in ``t x v T k c`` of its link or body and the parameters.

    Raises
    ------
    ValueError
        If the expression holds anything else.
    """
    kernel = _kernel(equation, tuple(parameters))
    return FreeForm(FREE_FORM, enters, equation, parameters, kernel, on_disk=False)


@cache
def _kernel(equation: str, parameters: tuple[str, ...]) -> Callable[..., float]:
    from numba import njit

    force = njit(error_model="numpy")(compile_expression(equation, _ARGUMENTS, parameters))

    def effect(t, x, v, T, k, c, s, p, ds, dT):  # type: ignore[no-untyped-def] # noqa: ARG001
        return force(t, x, v, T, k, c, p)

    return effect
