"""Equations of result files as MathML, which browsers typeset on their own."""

from __future__ import annotations

import ast
import re
import unicodedata
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

_SHORT = {"exponent": "n"}
_UPRIGHT = Markup(' mathvariant="normal"')
_DOTS = {1: "˙", 2: "¨"}
_MINUS = Markup("<mo>−</mo>")
_FUNCTION = Markup('<mi mathvariant="normal">')
_GAP = Markup('<mspace width="0.17em"></mspace>')  # between a factor and the name of a function
_OPERATORS: dict[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "−", ast.Mult: "\u2062"}
_ATOM = 9
_MISSING_TIMES = re.compile(r"(?<=[\w)])\s+(?=[A-Za-z_(])")
_DEEPEST = 40
_PRIME = re.compile(r"\b([A-Za-z_]\w*)'")
_RATE = re.compile(r"^d([A-Za-z_]\w*)/dt$")
_STATE = re.compile(r"^([A-Za-z])(\d+)$")
_BEFORE = "rate"  # of the tension, by the law that an effect changes
_DERIVATIVE = "derivative"  # name of a function that no equation has
_COMPARED: dict[type[ast.cmpop], str] = {ast.Gt: ">", ast.GtE: "≥", ast.Lt: "<", ast.LtE: "≤"}
_CASE = "<mtr><mtd><mrow>{}</mrow></mtd><mtd><mrow><mtext>{}</mtext>{}</mrow></mtd></mtr>"
_CASES = (
    '<mrow><mo>{{</mo><mtable columnalign="left left" displaystyle="true">'
    + _CASE.format("{1}", "where&nbsp;", "{0}")
    + _CASE.format("{2}", "else", "")
    + "</mtable></mrow>"
)
_SIGNS = {  # of a function with so many arguments
    ("sqrt", 1): "<msqrt>{}</msqrt>",
    ("abs", 1): "<mrow><mo>|</mo>{}<mo>|</mo></mrow>",
    ("where", 3): _CASES,
}
_SPELT = frozenset({"tanh", "log", "sin", "cos", "max", "min", "sign", "step"})


def math(*parts: str | Markup, block: bool = False) -> Markup:
    """Return a <math> element of MathML parts."""
    body = Markup("").join(Markup(part) for part in parts)
    display = Markup(' display="block"') if block else Markup("")
    return Markup("<math{}><mrow>{}</mrow></math>").format(display, body)


def symbol(name: str, dots: int = 0) -> Markup:
    """Return a name as a symbol: Greek where it spells a letter, its tail as subscript, dots on top."""
    if name == _BEFORE:
        return Markup("<msub>{}<mn>0</mn></msub>").format(symbol("T", 1))
    head, _, tail = _STATE.sub(r"\1_\2", _SHORT.get(name, name)).partition("_")
    base = Markup("<mi{}>{}</mi>").format(Markup("") if len(_letter(head)) == 1 else _UPRIGHT, _letter(head))
    if dots:
        base = Markup("<mover>{}<mo>{}</mo></mover>").format(base, _DOTS[dots])
    if not tail:
        return base
    return Markup("<msub>{}<mi{}>{}</mi></msub>").format(base, _UPRIGHT, _letter(tail).replace("_", " "))


def _letter(name: str) -> str:
    """Return the Greek letter that a name spells, or the name."""
    try:
        return unicodedata.lookup(f"GREEK SMALL LETTER {name.upper()}")
    except KeyError:
        return name


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
    right = expression(_PRIME.sub(rf"{_DERIVATIVE}(\1)", text))
    if right is None:
        return Markup("<p>{} <code>{}</code></p>").format(math(left, Markup("<mo>=</mo>")), text)
    return math(left, Markup("<mo>=</mo>"), right, block=True)


def effect_equations(text: str, enters: str) -> list[Markup]:
    """Return the equations of an effect, one for each part that a semicolon ends.

    A part without a left side is what the effect adds: a rate of the tension, a force, a reading.
    """
    lines = []
    for part in text.split(";"):
        left, equals, right = part.partition(" = ")
        if not equals:
            left, right = ("dT/dt" if enters == "tension" else "F"), part
        lines.append(equation(_left_side(left.strip()), right.strip()))
    return lines


def _left_side(text: str) -> Markup:
    """Return the left side of an equation: a symbol, the rate of one, or an expression."""
    rate = _RATE.match(text)
    if rate:
        return symbol(rate[1], 1)
    return expression(_PRIME.sub(rf"{_DERIVATIVE}(\1)", text)) or Markup("<mi>{}</mi>").format(text)


def _shown(node: ast.expr, depth: int) -> tuple[Markup, int]:
    """Return the MathML of a node and how tightly it binds."""
    if depth > _DEEPEST:
        raise ValueError("an expression to be shown must not be nested so deeply")
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return _value(f"{value:.6g}")
        case ast.Name(id=name):
            return symbol(name), _ATOM
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return _MINUS + _within(operand, 2, depth), 2
        case ast.BinOp():
            return _operation(node, depth)
        case ast.Compare(left=left, ops=[sign], comparators=[right]) if type(sign) in _COMPARED:
            text = _COMPARED[type(sign)]
            return _within(left, 1, depth) + Markup("<mo>{}</mo>").format(text) + _within(right, 1, depth), 0
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            return _call(name, arguments, depth)
    raise ValueError(f"{type(node).__name__} is not part of an expression")


def _value(text: str) -> tuple[Markup, int]:
    """Return a number, a power of ten written out."""
    mantissa, _, power = text.partition("e")
    if not power:
        return Markup("<mn>{}</mn>").format(mantissa), _ATOM
    ten = _power(Markup("<mn>10</mn>"), Markup("<mn>{}</mn>").format(str(int(power)).replace("-", "−")))
    return (ten, 4) if mantissa == "1" else (Markup("<mn>{}</mn><mo>·</mo>").format(mantissa) + ten, 2)


def _operation(node: ast.BinOp, depth: int) -> tuple[Markup, int]:
    if isinstance(node.op, ast.Div):
        top, bottom = _shown(node.left, depth + 1)[0], _shown(node.right, depth + 1)[0]
        return Markup("<mfrac><mrow>{}</mrow><mrow>{}</mrow></mfrac>").format(top, bottom), 3
    if isinstance(node.op, ast.Pow):
        power = _shown(node.right, depth + 1)[0]
        return _power(_within(node.left, 5, depth), power), 4
    if type(node.op) not in _OPERATORS:
        raise ValueError(f"{type(node.op).__name__} is not part of an expression")
    rank = 2 if isinstance(node.op, ast.Mult) else 1
    left, right = _within(node.left, rank, depth, leading=True), _within(node.right, rank + 1, depth)
    sign = "·" if rank == 2 and right.startswith("<mn>") else _OPERATORS[type(node.op)]
    gap = _GAP if rank == 2 and right.startswith(_FUNCTION) else Markup("")
    return left + Markup("<mo>{}</mo>").format(sign) + gap + right, rank


def _power(base: Markup, power: Markup) -> Markup:
    """Return a power; a fraction in the exponent is not made smaller still."""
    return Markup('<msup><mrow>{}</mrow><mstyle displaystyle="true">{}</mstyle></msup>').format(base, power)


def _within(node: ast.expr, rank: int, depth: int, *, leading: bool = False) -> Markup:
    """Return a node, in parentheses where it binds less tightly or its minus would follow a sign."""
    shown, own = _shown(node, depth + 1)
    if own >= rank and (leading or not shown.startswith(_MINUS)):
        return shown
    return _bracketed(shown)


def _bracketed(shown: Markup) -> Markup:
    """Return a part in parentheses as high as that part alone, not as the line that it stands in."""
    return Markup("<mrow><mo>(</mo>{}<mo>)</mo></mrow>").format(shown)


def _call(name: str, arguments: Sequence[ast.expr], depth: int) -> tuple[Markup, int]:
    shown = [_shown(argument, depth + 1)[0] for argument in arguments]
    if name == "max" and [ast.unparse(argument) for argument in arguments] in (["T", "0"], ["T", "0.0"]):
        return shown[0], _ATOM
    if name == "exp" and len(shown) == 1:
        return _power(Markup("<mi>e</mi>"), shown[0]), 4
    if name == _DERIVATIVE and len(arguments) == 1 and isinstance(arguments[0], ast.Name):
        return symbol(arguments[0].id, 1), _ATOM
    if (name, len(shown)) in _SIGNS:
        return Markup(_SIGNS[name, len(shown)]).format(*shown), _ATOM
    spelt = _FUNCTION + Markup("{}</mi>").format("ln" if name == "log" else name)
    listed = Markup("<mo>,</mo>").join(shown)
    return (spelt if name in _SPELT else symbol(name)) + _bracketed(listed), _ATOM


def equations_of_motion(bodies: Sequence[str], links: Sequence[Mapping[str, Any]]) -> list[Markup]:
    """Return m x'' + sum of link forces = F for every body; relative motion is first body minus second.

    Each is a row of terms, between which a narrow page breaks the line.
    """
    lines = []
    for body in bodies:
        terms = [symbol(f"m_{body}") + symbol(f"x_{body}", 2)]
        for link in links:
            ends = [str(end) for end in link.get("between", ())]
            if body in ends and len(ends) == 2:
                terms += _link_terms(link, ends, body)
        terms.append(Markup('<mo form="infix">=</mo>') + symbol(f"F_{body}"))
        lines.append(Markup('<p class="terms">{}</p>').format(Markup(" ").join(map(math, terms))))
    return lines


def of_tension() -> Markup:
    """Return the argument of a law that depends on the tension."""
    return _bracketed(Markup("<mi>T</mi>"))


def _link_terms(link: Mapping[str, Any], ends: Sequence[str], body: str) -> list[Markup]:
    sign = Markup('<mo form="infix">{}</mo>').format("+" if body == ends[0] else "−")
    tension = of_tension() if link.get("law") == "bolted" else Markup("")
    return [
        sign + symbol(f"{letter}_{link['name']}") + tension + _relative(ends, dots)
        for letter, dots in (("k", 0), ("c", 1))
        if letter == "c" or link.get("law") != "dashpot"
    ]


def _relative(ends: Sequence[str], dots: int) -> Markup:
    """Return the motion of the first body minus that of the second; ground stands still."""
    first, second = (None if end == "ground" else symbol(f"x_{end}", dots) for end in ends)
    if first is not None and second is None:
        return Markup("<mo>\u2062</mo>") + first
    parts = _MINUS + (second or Markup("")) if first is None else first + _MINUS + (second or Markup(""))
    return _bracketed(parts)
