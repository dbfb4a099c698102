"""Dimensions of arithmetic expressions: which unit a tension rate has, by the units of its parameters."""

from __future__ import annotations

import ast
from collections.abc import Mapping

from rom.model.units import unit_text

Powers = tuple[float, float, float]
"""Of N, m and s."""

RATE: Powers = (1.0, 0.0, -1.0)
ARGUMENTS: Mapping[str, Powers] = {
    "T": (1.0, 0.0, 0.0),
    "x": (0.0, 1.0, 0.0),
    "v": (0.0, 1.0, -1.0),
    "F": (1.0, 0.0, 0.0),
    "D": (1.0, 0.0, 0.0),
}
_NONE: Powers = (0.0, 0.0, 0.0)
_SAME = 1e-6
_CALLS = ("exp", "log", "sqrt", "tanh", "abs", "sign", "min", "max")


def spaced(expression: str) -> str:
    """The expression as Python prints it, with spaces and no brackets that say nothing.

    Raises
    ------
    ValueError
        If it cannot be read.
    """
    return ast.unparse(_tree(expression))


def free_names(expression: str) -> tuple[str, ...]:
    """Names in an expression that are neither arguments nor functions, in the order of the text.

    Raises
    ------
    ValueError
        If it cannot be read.
    """
    found = [node for node in ast.walk(_tree(expression)) if isinstance(node, ast.Name)]
    found.sort(key=lambda node: (node.lineno, node.col_offset))
    return tuple(dict.fromkeys(n.id for n in found if n.id not in (*ARGUMENTS, *_CALLS)))


def dimension_of(
    expression: str, units: Mapping[str, Powers], values: Mapping[str, float] | None = None
) -> Powers:
    """Powers of N, m and s of an expression in ``T x v F D`` and parameters.

    Parameters
    ----------
    expression : str
        Arithmetic, as for `rom.model.laws.free_form_law`.
    units : mapping of str to (float, float, float)
        Powers of N, m and s of every parameter.
    values : mapping of str to float, optional
        Values of parameters that are exponents.

    Returns
    -------
    tuple of float
        Powers of N, m and s.

    Raises
    ------
    ValueError
        If quantities of different units are added or compared, a function's argument or an exponent has a
        unit, or a name has none.
    """
    return _Reader(units, values or {}).read(_tree(expression))[0]


def _tree(expression: str) -> ast.expr:
    try:
        return ast.parse(expression.strip(), mode="eval").body
    except SyntaxError as error:
        raise ValueError(f"an expression must be arithmetic, got {expression!r}") from error


class _Reader:
    """Reads a tree from its leaves: powers, and whether it is a bare number, which fits beside any unit."""

    def __init__(self, units: Mapping[str, Powers], values: Mapping[str, float]) -> None:
        self.units, self.values = {**ARGUMENTS, **units}, values

    def read(self, node: ast.expr) -> tuple[Powers, bool]:
        if isinstance(node, ast.Constant):
            return _NONE, True
        if isinstance(node, ast.Name):
            if node.id not in self.units:
                raise ValueError(f"found {node.id!r}, expected one of {', '.join(self.units)}")
            return self.units[node.id], False
        if isinstance(node, ast.UnaryOp):
            return self.read(node.operand)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            return self._call(node.func.id, node)
        if isinstance(node, ast.BinOp):
            return self._of_two(node)
        raise ValueError(f"an expression must be arithmetic, got {ast.unparse(node)!r}")

    def _call(self, name: str, node: ast.Call) -> tuple[Powers, bool]:
        if name in ("min", "max"):
            return self._alike(node.args, node), False
        powers, _ = self.read(node.args[0]) if node.args else (_NONE, True)
        if name == "abs":
            return powers, False
        if name == "sqrt":
            return _times(powers, 0.5), False
        if name != "sign" and not _is_none(powers):
            raise ValueError(
                f"{ast.unparse(node)}: found an argument in {_text(powers)}, expected a number without unit"
            )
        return _NONE, False

    def _alike(self, nodes: list[ast.expr], whole: ast.expr) -> Powers:
        found = [powers for powers, bare in map(self.read, nodes) if not bare]
        for powers in found[1:]:
            if any(abs(a - b) > _SAME for a, b in zip(powers, found[0], strict=True)):
                raise ValueError(
                    f"{ast.unparse(whole)}: found {_text(found[0])} and {_text(powers)}, expected one unit"
                )
        return found[0] if found else _NONE

    def _of_two(self, node: ast.BinOp) -> tuple[Powers, bool]:
        if isinstance(node.op, ast.Add | ast.Sub):
            bare = all(self.read(side)[1] for side in (node.left, node.right))
            return self._alike([node.left, node.right], node), bare
        (left, bare), (right, other) = self.read(node.left), self.read(node.right)
        if isinstance(node.op, ast.Pow):
            return self._power(node, left, right), bare
        sign = -1.0 if isinstance(node.op, ast.Div) else 1.0
        return _sum(left, _times(right, sign)), bare and other

    def _power(self, node: ast.BinOp, base: Powers, exponent: Powers) -> Powers:
        if not _is_none(exponent):
            raise ValueError(
                f"{ast.unparse(node)}: found an exponent in {_text(exponent)}, expected a number without unit"
            )
        if _is_none(base):
            return _NONE
        code = compile(ast.Expression(node.right), "<exponent>", "eval")
        try:
            value = float(eval(code, {"__builtins__": {}}, dict(self.values)))
        except (NameError, TypeError, ArithmeticError) as error:
            raise ValueError(
                f"{ast.unparse(node)}: expected an exponent of numbers and parameters"
            ) from error
        return _times(base, value)


def _times(powers: Powers, factor: float) -> Powers:
    return (powers[0] * factor, powers[1] * factor, powers[2] * factor)


def _sum(a: Powers, b: Powers) -> Powers:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _is_none(powers: Powers) -> bool:
    return all(abs(power) <= _SAME for power in powers)


def _text(powers: Powers) -> str:
    return unit_text(dict(zip(("N", "m", "s"), powers, strict=True)))
