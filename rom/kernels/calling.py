"""Compiled laws as addresses, and the call of an address from compiled code."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import cfunc, types
from numba.core.cgutils import ir  # type: ignore[attr-defined]
from numba.extending import intrinsic

_POINTER: Any = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
_SCALAR = types.float64

SIGNATURES = {
    # (tension, p) -> stiffness [N/m] or damping [N s/m]
    "stiffness": _SCALAR(_SCALAR, _POINTER),
    "damping": _SCALAR(_SCALAR, _POINTER),
    # (tension, relative displacement, relative velocity, link force, damping force, p) -> dT/dt [N/s]
    "tension rate": _SCALAR(*[_SCALAR] * 5, _POINTER),
    # (time, displacement, velocity, tension, stiffness, damping, state, p, state_rate, tension_rate) -> force
    "effect": _SCALAR(*[_SCALAR] * 6, *[_POINTER] * 4),
}


@cache
def _compiled(function: Callable[..., float], enters: str, on_disk: bool) -> Any:
    if on_disk:
        try:
            return cfunc(SIGNATURES[enters], cache=True, error_model="numpy")(function)
        except RuntimeError:  # no file, or no folder to write to: compiled anew by every process
            pass
    return cfunc(SIGNATURES[enters], error_model="numpy")(function)


def address_of(function: Callable[..., float], enters: str, on_disk: bool = True) -> int:
    """Compile a scalar function to the signature of the place where it enters; its address.

    Parameters
    ----------
    function : callable
        Plain function of scalars and parameter arrays in the order of ``SIGNATURES[enters]``.
    enters : {"stiffness", "damping", "tension rate", "effect"}
        The place, which fixes the signature.
    on_disk : bool
        Keep the compiled code on disk, where the function lives in a file and there is a place for it.

    Returns
    -------
    int
        Address of machine code, valid as long as the process lives.
    """
    return int(_compiled(function, enters, on_disk).address)


def _invoke(typing_context: Any, address: Any, arguments: Any) -> Any:  # noqa: ARG001 - fixed by numba
    """Call the float64 function at ``address``; arrays in ``arguments`` pass as pointers to their data."""
    signature = types.float64(address, arguments)

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        passed = []
        for place, kind in enumerate(arguments):
            value = builder.extract_value(values[1], place)
            if isinstance(kind, types.Array):
                value = context.make_array(kind)(context, builder, value=value).data
            passed.append(value)
        function = ir.FunctionType(ir.DoubleType(), [value.type for value in passed])
        return builder.call(builder.inttoptr(values[0], function.as_pointer()), passed)

    return signature, generate


def _pointer(typing_context: Any, array: Any, offset: Any) -> Any:  # noqa: ARG001 - fixed by numba
    """Pointer to the element ``offset`` of a contiguous array, counted flat, without a slice."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, value=values[0]).data
        return builder.gep(data, [values[1]])

    return _POINTER(array, offset), generate


invoke: Any = intrinsic(_invoke)
pointer: Any = intrinsic(_pointer)
