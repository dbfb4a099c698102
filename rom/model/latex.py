r"""Expressions as LaTeX: ``-gamma * abs(v) ** n * max(T, 0)`` as ``-\gamma \left|v\right|^{n} T``."""

from __future__ import annotations

import ast
import re
import unicodedata
from collections.abc import Callable, Mapping

_SUM, _NEGATIVE, _PRODUCT, _POWER, _ATOM = range(5)  # how tightly a part binds; negative: it starts with -
_CALLS: Mapping[str, str] = {
    "abs": r"\left|{0}\right|",
    "sqrt": r"\sqrt{{{0}}}",
    "exp": r"\mathrm{{e}}^{{{0}}}",
    "log": r"\ln\left({0}\right)",
    "tanh": r"\tanh\left({0}\right)",
    "sign": r"\operatorname{{sign}}\left({0}\right)",
    "max": r"\max\left({0}, {1}\right)",
    "min": r"\min\left({0}, {1}\right)",
}


def latex_of(expression: str) -> str:
    r"""Write an arithmetic expression as LaTeX; ``max(T, 0)`` is T: a joint without tension stays without.

    Raises
    ------
    ValueError
        If it is more than arithmetic.

    Examples
    --------
    >>> print(latex_of("-gamma * abs(v) ** n * max(T, 0)"))
    -\gamma \left|v\right|^{n} T
    >>> print(latex_of("-10 ** (-gamma_i / (1 + exp(rho * T)))"))
    -10^{-\frac{\gamma_{i}}{1 + \mathrm{e}^{\rho T}}}
    """
    try:
        tree = ast.parse(expression.strip(), mode="eval").body
    except SyntaxError as error:
        raise ValueError(f"an expression must be arithmetic, got {expression!r}") from error
    return _part(tree)[0]


def _part(node: ast.expr) -> tuple[str, int]:
    """Return the LaTeX of a part and how tightly it binds."""
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return _number(f"{value:.6g}")
        case ast.Name(id=name):
            return _symbol(name), _ATOM
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return f"-{_within(operand, _PRODUCT)}", _NEGATIVE
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _OPERATIONS:
            return _OPERATIONS[type(sign)](left, right)
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in _CALLS:
            return _call(name, arguments)
    raise ValueError(f"an expression must be arithmetic, got {ast.unparse(node)!r}")


def _call(name: str, arguments: list[ast.expr]) -> tuple[str, int]:
    if name == "max" and [ast.unparse(argument) for argument in arguments] == ["T", "0"]:
        return "T", _ATOM
    text = _CALLS[name].format(*(_part(argument)[0] for argument in arguments))
    return text, _POWER if name == "exp" else _ATOM


def _power(base: ast.expr, exponent: ast.expr) -> tuple[str, int]:
    return f"{_within(base, _ATOM)}^{{{_part(exponent)[0]}}}", _POWER


def _fraction(top: ast.expr, bottom: ast.expr) -> tuple[str, int]:
    """Return a fraction, a leading minus before it."""
    over, binding = _part(top)
    minus = "-" if binding == _NEGATIVE else ""
    text = rf"{minus}\frac{{{over.removeprefix(minus)}}}{{{_part(bottom)[0]}}}"
    return text, _NEGATIVE if minus else _PRODUCT


def _product(first: ast.expr, second: ast.expr) -> tuple[str, int]:
    left, right = _within(first, _NEGATIVE), _within(second, _PRODUCT)
    sign = r" \cdot " if right[0].isdigit() else " "
    return f"{left}{sign}{right}", _NEGATIVE if left.startswith("-") else _PRODUCT


def _sum(first: ast.expr, second: ast.expr) -> tuple[str, int]:
    return f"{_part(first)[0]} + {_within(second, _PRODUCT)}", _SUM


def _difference(first: ast.expr, second: ast.expr) -> tuple[str, int]:
    return f"{_part(first)[0]} - {_within(second, _PRODUCT)}", _SUM


_OPERATIONS: Mapping[type[ast.operator], Callable[[ast.expr, ast.expr], tuple[str, int]]] = {
    ast.Pow: _power,
    ast.Div: _fraction,
    ast.Mult: _product,
    ast.Add: _sum,
    ast.Sub: _difference,
}


def _within(node: ast.expr, least: int) -> str:
    """Return a part, in brackets where it binds less tightly."""
    text, binding = _part(node)
    return text if binding >= least else rf"\left({text}\right)"


def _number(text: str) -> tuple[str, int]:
    mantissa, _, power = text.partition("e")
    if not power:
        return mantissa, _ATOM
    ten = f"10^{{{int(power)}}}"
    return (ten, _POWER) if mantissa == "1" else (rf"{mantissa} \cdot {ten}", _PRODUCT)


def _symbol(name: str) -> str:
    """Return a name, Greek where it spells a letter, what follows an underscore or a digit as subscript."""
    head, _, tail = re.sub(r"^([A-Za-z])(\d+)$", r"\1_\2", name).partition("_")
    text = _letter(head)
    if not tail:
        return text
    parts = ", ".join(_letter(part) for part in tail.split("_"))
    return f"{text}_{{{parts}}}"


def _letter(name: str) -> str:
    try:
        unicodedata.lookup(f"GREEK SMALL LETTER {name.upper()}")
    except KeyError:
        return name if len(name) == 1 or name.isdigit() else rf"\mathrm{{{name}}}"
    return rf"\{name.lower()}"
