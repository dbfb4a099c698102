"""Small compiled functions in a table: one integrator calls them by address and is compiled once for all."""

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import cfunc, types
from numba.core.cgutils import ir  # type: ignore[attr-defined]
from numba.extending import intrinsic

SCALAR = types.float64
ARRAY: Any = types.CPointer(types.float64)  # type: ignore[no-untyped-call]

FORCE: Any = SCALAR(*[SCALAR] * 5, *[ARRAY] * 3)
"""``f(t, x, v, T, k, s, p, ds) -> force [N]``; see `experiments.rig.forces`."""

RATE: Any = SCALAR(*[SCALAR] * 8, ARRAY)
"""``f(rate, T, x, v, a, F, D, follow, p) -> rate [N/s]``; see `experiments.rig.rates`."""


@cache
def address_of(function: Callable[..., float], signature: Any) -> int:
    """Compile a function, kept on disk; return the address of its machine code."""
    return int(_compiled(function, signature).address)


@cache
def _compiled(function: Callable[..., float], signature: Any) -> Any:
    return cfunc(signature, cache=True, error_model="numpy")(function)


def _call(_typing: Any, address: Any, arguments: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        passed = []
        for place, kind in enumerate(arguments):
            value = builder.extract_value(values[1], place)
            if isinstance(kind, types.Array):
                value = context.make_array(kind)(context, builder, value=value).data
            passed.append(value)
        function = ir.FunctionType(ir.DoubleType(), [value.type for value in passed])
        return builder.call(builder.inttoptr(values[0], function.as_pointer()), passed)

    return types.float64(address, arguments), generate


def _pointer(_typing: Any, array: Any, offset: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, value=values[0]).data
        return builder.gep(data, [values[1]])

    return ARRAY(array, offset), generate


pointer: Any = intrinsic(_pointer)
"""``pointer(array, offset)`` in compiled code: to an element of a contiguous array, counted flat."""

call: Any = intrinsic(_call)
"""``call(address, arguments)`` in compiled code; an array passes as the pointer to its data."""
