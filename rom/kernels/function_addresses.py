"""Compiled laws and parts of kernels as addresses, and the call of an address from compiled code."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import cfunc, float64, int64, njit, types
from numba.core.cgutils import ir  # type: ignore[attr-defined]
from numba.extending import intrinsic

from rom.kernels import paused_gc  # noqa: F401 - before anything is compiled

_POINTER: Any = types.CPointer(float64)  # type: ignore[no-untyped-call]
_SCALAR = float64

# kernels that are given all their arrays need not count who holds them, which is half of their code
ALLOCATES_NOTHING: Any = {"cache": True, "error_model": "numpy", "_nrt": False}
# nor do those that kernels alone call need what Python would call
INNER: Any = {**ALLOCATES_NOTHING, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

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


@cache
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
    signature = float64(address, arguments)

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


def floats(dimensions: int, readonly: bool = False) -> Any:
    """Type of a contiguous array of numbers."""
    return types.Array(float64, dimensions, "C", readonly=readonly)


def integers(dimensions: int) -> Any:
    """Type of a contiguous array of integers."""
    return types.Array(int64, dimensions, "C")


def named(group: type, *kinds: Any) -> Any:
    """Type of a NamedTuple whose fields have these types."""
    return types.BaseTuple.from_types(kinds, group)  # type: ignore[no-untyped-call]


def separate(result: Any, *kinds: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a large part of a kernel that is compiled by itself and called by its address.

    LLVM optimises all that a function calls again within that function, which for one that calls all others
    is most of a first run. What comes of it is called in kernels as ``part(address, (arguments))``, not from
    Python: only that costs a wrapper; ``part.address()`` compiles it, or finds it on disk.

    Parameters
    ----------
    result : numba type
        What it returns.
    *kinds : numba type
        Of its arguments.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        kernel: Any = njit(**INNER)(function)

        def call(_typing: Any, address: Any, arguments: Any) -> Any:
            def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
                passed = [
                    context.cast(builder, builder.extract_value(values[1], place), given, kind)
                    for place, (given, kind) in enumerate(zip(arguments, kinds, strict=True))
                ]
                convention = context.call_conv
                machine = convention.get_function_type(result, kinds).as_pointer()
                status, value = convention.call_function(
                    builder, builder.inttoptr(values[0], machine), result, kinds, passed
                )
                with builder.if_then(status.is_error, likely=False):
                    convention.return_status_propagate(builder, status)
                return value

            return result(address, arguments), generate

        def address() -> int:
            kernel.compile(kinds)
            made = kernel.overloads[kinds]
            return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))

        part: Any = intrinsic(call)
        part.address = cache(address)
        return part

    return decorate


def _for_size(_typing: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, _values: Any) -> Any:
        builder.function.attributes.add("optsize")
        return context.get_dummy_value()

    return types.void(), generate


for_size: Any = intrinsic(_for_size)
"""``for_size()`` in a kernel: its loops are short, so that unrolling and vectorising them gains nothing."""
