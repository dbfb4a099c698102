"""Arithmetic expressions as functions: one text for people, for files and for the compiler."""

from __future__ import annotations

import ast
import hashlib
import math
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np

_CALLS = {"exp": 1, "log": 1, "sqrt": 1, "tanh": 1, "abs": 1, "sign": 1, "min": 2, "max": 2}
_OF_ARRAYS = {"min": "minimum", "max": "maximum"}
_NODES = (
    ast.Expression,
    ast.BinOp,
    ast.UnaryOp,
    ast.Load,
    ast.Add,
    ast.Sub,
    ast.Mult,
    ast.Div,
    ast.Pow,
    ast.USub,
    ast.UAdd,
)


def _sign(value: float) -> float:
    return math.copysign(1.0, value) if value != 0.0 else 0.0


class _Placed(ast.NodeTransformer):
    """Checks every node and turns parameter names into places of the parameter array."""

    def __init__(self, arguments: tuple[str, ...], parameters: tuple[str, ...]) -> None:
        self.arguments = arguments
        self.parameters = parameters

    def visit(self, node: ast.AST) -> ast.AST:
        """Refuse every node that is not arithmetic."""
        if isinstance(node, ast.Call):
            return self._call(node)
        if isinstance(node, ast.Name):
            return self._name(node)
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            return ast.Constant(float(node.value))
        if isinstance(node, _NODES):
            return self.generic_visit(node)
        raise ValueError(f"an expression must be arithmetic, got {type(node).__name__}")

    def _call(self, node: ast.Call) -> ast.AST:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if len(node.args) != _CALLS.get(name, -1) or node.keywords:
            raise ValueError(f"an expression may call {', '.join(_CALLS)}, got {ast.unparse(node)!r}")
        node.args = [cast(ast.expr, self.visit(argument)) for argument in node.args]
        return node

    def _name(self, node: ast.Name) -> ast.AST:
        if node.id in self.parameters:
            place = ast.Constant(self.parameters.index(node.id))
            return ast.Subscript(ast.Name("p", ast.Load()), place, ast.Load())
        if node.id in self.arguments:
            return node
        known = ", ".join((*self.arguments, *self.parameters))
        raise ValueError(f"an expression may use {known}, got {node.id!r}")


@cache
def compile_expression(
    expression: str, arguments: tuple[str, ...], parameters: tuple[str, ...], *, arrays: bool = False
) -> Callable[..., Any]:
    """A function ``f(*arguments, p)`` from an arithmetic expression; equal texts give the same function.

    Parameters
    ----------
    expression : str
        Arithmetic in arguments and parameters.
    arguments : tuple of str
        Names of the arguments, in order.
    parameters : tuple of str
        Names of the parameters, in order.
    arrays : bool
        Whether its arguments are arrays; otherwise scalars, for the compiler.

    Returns
    -------
    Callable
        The function.

    Raises
    ------
    ValueError
        If the expression cannot be read or is more than arithmetic.
    """
    clash = sorted(set(parameters) & {*arguments, *_CALLS, "p"})
    if clash or not all(name.isidentifier() for name in parameters):
        raise ValueError(
            f"parameter names must be identifiers other than {', '.join(arguments)}, got {parameters}"
        )
    try:
        tree = ast.parse(expression, mode="eval")
    except SyntaxError as error:
        raise ValueError(f"an expression must be arithmetic, got {expression!r}") from error
    body = ast.fix_missing_locations(_Placed(arguments, parameters).visit(tree))
    source = f"def law({', '.join((*arguments, 'p'))}):\n    return 1.0 * ({ast.unparse(body)})\n"
    names: dict[str, object] = {name: getattr(math, name) for name in ("exp", "log", "sqrt", "tanh")}
    names["__name__"] = __name__  # of a module that compiled code can be loaded beside
    names["sign"] = _compilable_sign()
    if arrays:
        names = {name: getattr(np, _OF_ARRAYS.get(name, name)) for name in _CALLS}
    code = compile(source, "<law>" if arrays else _file_of(source), "exec")
    exec(code, names)  # nothing but checked arithmetic reaches this line
    function = names["law"]
    assert callable(function)
    return function


def is_linear_in(expression: str, name: str) -> bool:
    """Whether an arithmetic expression is linear in one of its names, as far as its form says."""
    return _degree(ast.parse(expression.strip(), mode="eval").body, name) == 1.0


def _degree(node: ast.expr, name: str) -> float:
    """Degree of a polynomial in a name; infinite where the expression is none."""
    if isinstance(node, ast.Name):
        return float(node.id == name)
    if isinstance(node, ast.UnaryOp):
        return _degree(node.operand, name)
    if isinstance(node, ast.Call):
        return math.inf if any(_degree(argument, name) for argument in node.args) else 0.0
    return _degree_of_two(node, name) if isinstance(node, ast.BinOp) else 0.0


def _degree_of_two(node: ast.BinOp, name: str) -> float:
    left, right = _degree(node.left, name), _degree(node.right, name)
    if isinstance(node.op, ast.Add | ast.Sub):
        return max(left, right)
    if isinstance(node.op, ast.Mult):
        return left + right
    if right or (left and isinstance(node.op, ast.Pow)):
        return math.inf
    return left


def is_on_disk(function: Callable[..., Any]) -> bool:
    """Whether a function has a file, so that its compiled code can be kept beside it."""
    return Path(function.__code__.co_filename).is_absolute()


def _file_of(source: str) -> str:
    """A file with this source among a user's cached files, for the compiled code to be kept beside it."""
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
        path = Path(base, "boltlaw", f"law_{hashlib.sha256(source.encode()).hexdigest()[:24]}.py")
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            new = path.with_suffix(f".{os.getpid()}")
            new.write_text(source, encoding="utf-8")
            new.replace(path)
    except (OSError, RuntimeError):  # no place to write to: compiled anew by every process
        return "<law>"
    return str(path.absolute())


def _compilable_sign() -> object:
    from numba.extending import register_jitable

    return register_jitable(_sign)
