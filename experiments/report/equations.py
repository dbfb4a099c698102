"""Equations of result files as MathML, which browsers typeset on their own."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup, escape

_GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ",
    "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ",
    "phi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω",
}  # fmt: skip
_SHORT = {"exponent": "n"}
_OPERATORS: dict[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "−", ast.Mult: "\u2062"}
_RANK: dict[type[ast.operator], int] = {ast.Add: 1, ast.Sub: 1, ast.Mult: 2, ast.Div: 3, ast.Pow: 4}
_ATOM = 9
_MISSING_TIMES = re.compile(r"(?<=[\w)])\s+(?=[A-Za-z_(])")
_DEEPEST = 40


def math(*parts: str | Markup, block: bool = False) -> Markup:
    """Return a <math> element of MathML parts."""
    body = Markup("").join(Markup(part) for part in parts)
    display = Markup(' display="block"') if block else Markup("")
    return Markup("<math{}><mrow>{}</mrow></math>").format(display, body)


def symbol(name: str) -> Markup:
    """Return a name as a symbol: Greek where it spells a Greek letter, what follows an underscore as subscript."""
    head, _, tail = _SHORT.get(name, name).partition("_")
    upright = "" if len(head) == 1 or head in _GREEK else ' mathvariant="normal"'
    base = Markup("<mi{}>{}</mi>").format(Markup(upright), _GREEK.get(head, head))
    if not tail:
        return base
    return Markup('<msub>{}<mi mathvariant="normal">{}</mi></msub>').format(base, _GREEK.get(tail, tail))


def dotted(base: Markup, dots: int = 1) -> Markup:
    """Return a time derivative."""
    return Markup("<mover>{}<mo>{}</mo></mover>").format(base, "˙" if dots == 1 else "¨")


def expression(text: str) -> Markup | None:
    """Return an arithmetic expression as MathML; None where it is not one.

    ``max(T, 0)`` is shown as T: a joint without tension stays without.
    """
    for candidate in (text, _MISSING_TIMES.sub(" * ", text)):
        try:
            return _shown(ast.parse(candidate.strip(), mode="eval").body, 0)[0]
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            continue
    return None


def equation(left: Markup, text: str) -> Markup:
    """Return ``left = text`` as one displayed equation; text that is no expression is shown as it is."""
    right = expression(text)
    if right is None:
        return Markup("<p>{} <code>{}</code></p>").format(math(left, Markup("<mo>=</mo>")), text)
    return math(left, Markup("<mo>=</mo>"), right, block=True)


def _shown(node: ast.expr, depth: int) -> tuple[Markup, int]:
    """Return the MathML of a node and how tightly it binds."""
    if depth > _DEEPEST:
        raise ValueError("an expression to be shown must not be nested so deeply")
    match node:
        case ast.Constant(value=bool() | str() | bytes()):
            raise ValueError("only numbers are shown")
        case ast.Constant(value=int() | float() as value):
            return Markup("<mn>{}</mn>").format(f"{value:.6g}"), _ATOM
        case ast.Name(id=name):
            return symbol(name), _ATOM
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return Markup("<mo>−</mo>") + _within(operand, 2, depth), 1
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            top, bottom = _shown(left, depth + 1)[0], _shown(right, depth + 1)[0]
            return Markup("<mfrac><mrow>{}</mrow><mrow>{}</mrow></mfrac>").format(top, bottom), 3
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            base, power = _within(left, 5, depth), _shown(right, depth + 1)[0]
            return Markup("<msup><mrow>{}</mrow><mrow>{}</mrow></msup>").format(base, power), 4
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATORS:
            rank = _RANK[type(operator)]
            sign = Markup("<mo>{}</mo>").format(_OPERATORS[type(operator)])
            return _within(left, rank, depth) + sign + _within(right, rank + 1, depth), rank
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            return _call(name, arguments, depth)
    raise ValueError(f"{type(node).__name__} is not part of an expression")


def _within(node: ast.expr, rank: int, depth: int) -> Markup:
    """Return the MathML of a node, in parentheses where it binds less tightly than `rank`."""
    shown, own = _shown(node, depth + 1)
    return shown if own >= rank else Markup("<mo>(</mo>{}<mo>)</mo>").format(shown)


def _call(name: str, arguments: Sequence[ast.expr], depth: int) -> tuple[Markup, int]:
    shown = [_shown(argument, depth + 1)[0] for argument in arguments]
    if name == "max" and len(arguments) == 2 and ast.unparse(arguments[1]) in ("0", "0.0"):
        return _shown(arguments[0], depth + 1)
    if name == "exp" and len(shown) == 1:
        return Markup("<msup><mi>e</mi><mrow>{}</mrow></msup>").format(shown[0]), 4
    if name == "sqrt" and len(shown) == 1:
        return Markup("<msqrt>{}</msqrt>").format(shown[0]), _ATOM
    if name == "abs" and len(shown) == 1:
        return Markup("<mo>|</mo>{}<mo>|</mo>").format(shown[0]), _ATOM
    listed = Markup("<mo>,</mo>").join(shown)
    return Markup('<mi mathvariant="normal">{}</mi><mo>(</mo>{}<mo>)</mo>').format(name, listed), _ATOM


def equations_of_motion(bodies: Sequence[str], links: Sequence[Mapping[str, Any]]) -> list[Markup]:
    """Return m x'' + sum of link forces = F for every body; a link's relative motion is first minus second."""
    lines = []
    for body in bodies:
        terms = Markup("{}{}").format(_of("m", body), dotted(_of("x", body), 2))
        for link in links:
            ends = [str(end) for end in link.get("between", ())]
            if body in ends and len(ends) == 2:
                terms += _link_terms(link, ends, body)
        lines.append(math(terms, Markup("<mo>=</mo>"), _of("F", body), block=True))
    return lines


def _link_terms(link: Mapping[str, Any], ends: Sequence[str], body: str) -> Markup:
    sign = "+" if body == ends[0] else "−"
    terms = Markup("")
    for letter, place, dots in (("k", "stiffness", 0), ("c", "damping", 1)):
        if place == "stiffness" and link.get("law") == "dashpot":
            continue
        motions = [dotted(_of("x", end), dots) if dots else _of("x", end) for end in ends if end != "ground"]
        if ends[0] == "ground":
            motion = Markup("<mo>(</mo><mo>−</mo>{}<mo>)</mo>").format(motions[0])
        elif len(motions) == 2:
            motion = Markup("<mo>(</mo>{}<mo>−</mo>{}<mo>)</mo>").format(*motions)
        else:
            motion = motions[0]
        tension = Markup("<mo>(</mo><mi>T</mi><mo>)</mo>") if link.get("law") == "bolted" else Markup("")
        terms += Markup("<mo>{}</mo>{}{}<mo>\u2062</mo>{}").format(
            sign, _of(letter, str(link["name"])), tension, motion
        )
    return terms


def _of(letter: str, name: str) -> Markup:
    return Markup('<msub><mi>{}</mi><mi mathvariant="normal">{}</mi></msub>').format(letter, escape(name))
