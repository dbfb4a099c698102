"""Libraries of one's own: the columns of a pysindy library as terms of tension laws, by their names.

A library sees ``v, x, T, F, D`` as its five inputs: relative velocity and displacement of the joint, tension,
the joint's force and the damping part of that, in SI units. Each of its columns becomes a term ``-c column``
of dT/dt by its feature name, read as an expression (``^`` and ``|v|`` as pysindy and people write them, a
space between factors as a product). Its values decide whether the name is true.
"""

from __future__ import annotations

import ast
import copy
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discovery.laws.given import AT_REST, TRIED_TENSIONS, GivenLaw
from discovery.laws.names import in_symbols
from discovery.search.quick_likelihood import Found
from discovery.search.sparse_regression import node_weights
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.model.dimensions import RATE, dimension_of, spaced
from rom.model.expressions import compile_expression
from rom.model.laws import Parameter, free_form_law
from rom.model.units import unit_text

if TYPE_CHECKING:
    from discovery.courses.frozen_motion import FrozenMotion

INPUTS = ("v", "x", "T", "F", "D")
_ROW = {"v": 2, "x": 1, "T": 5, "F": 3, "D": 4}  # of the nodes of a frozen motion
_CHECKED: Numerical[int] = 2000  # nodes at which names are compared with values
_SAME: Numerical[float] = 1e-6
_SHOWN: Numerical[int] = 5  # of columns left out
_UNKNOWN = "SI"  # unit where numbers in an expression have units of their own
_ABSOLUTE = re.compile(r"\|([^|]+)\|")
_PRODUCT = re.compile(r"(?<=[\w)])\s+(?=[\w(])")


@dataclass(frozen=True, eq=False)
class OwnLibrary:
    """A library of one's own along the motion of a campaign.

    Attributes
    ----------
    name : str
        Name in the source of candidates.
    texts : tuple of str
        Expression of every column that can be a term.
    integrals : ndarray, shape (cases, bins, columns)
        Integrals of the columns from the hit, averaged over bins, each over its `scales` [s].
    scales : ndarray, shape (columns,)
        Largest size of every column along the motion, in its unit; negative where its integral has the sign
        of a loss: a positive coefficient loosens.
    note : str
        Which columns cannot be terms; empty if all can.
    """

    name: str
    texts: tuple[str, ...]
    integrals: FloatArray
    scales: FloatArray
    note: str = ""

    def law(self, found: Found) -> GivenLaw:
        """The law of a sum of columns."""
        pairs = sorted(zip(found.columns, found.coefficients, strict=True))
        sizes = [value / self.scales[column] for column, value in pairs]
        texts = [self.texts[column] for column, _ in pairs]
        labels = ["gamma"] if len(pairs) == 1 else [f"gamma_{k}" for k in range(1, len(pairs) + 1)]
        signs = ["-" if size > 0 else "+" for size in sizes]
        rate = " ".join(f"{s} {c} * {_factor(t)}" for s, c, t in zip(signs, labels, texts, strict=True))
        name = " ".join(
            f"{'-' if s == '+' else '+'} {in_symbols(t)}" for s, t in zip(signs, texts, strict=True)
        )
        numbers = {
            label: Parameter(abs(size), _unit(text), bounds=(0.0, np.inf))
            for label, size, text in zip(labels, sizes, texts, strict=True)
        }
        law = free_form_law(name.removeprefix("+ "), spaced(rate.removeprefix("+ ")), "tension rate", numbers)
        free = tuple(labels)
        return GivenLaw(law.name, (), (), "; ".join(found.sources), rate=law, free_names=free, scales=free)


def read_library(library: Any, name: str, frozen: FrozenMotion, *, signed: bool) -> OwnLibrary:
    """Evaluate a pysindy library along a motion, and read the names of its columns.

    Parameters
    ----------
    library : object
        With ``fit``, ``transform`` and ``get_feature_names``; it is copied, not changed.
    name : str
        What it is called.
    frozen : FrozenMotion
        Motion of the cases, the tension falling as it does.
    signed : bool
        Whether terms may tighten: columns then keep their sign.

    Returns
    -------
    OwnLibrary
        Without columns that would change the tension while nothing moves.

    Raises
    ------
    ValueError
        If a column is not a number, its name cannot be read or does not give its values, or none can be a
        term.
    """
    fitted, named = expressions(library, name)
    names, texts = list(named), list(named.values())
    rows = _inputs(frozen.nodes)
    few = rows[:: max(len(rows) // _CHECKED, 1)]
    columns = _transformed(fitted, few)
    for text, column in zip(names, columns.T, strict=True):
        _check_values(text, named[text], name, few, column)
    kept = [k for k, text in enumerate(texts) if _is_still(text)]
    if not kept:
        raise ValueError(
            f"library {name}: found no column that is zero while nothing moves (v = x = F = D = 0), "
            "expected one: multiply by a motion"
        )
    weighted, scales = [], np.full(len(kept), np.finfo(float).tiny)
    for case in range(len(frozen)):
        nodes = frozen.of_case(case)
        columns = _transformed(fitted, _inputs(nodes))[:, kept]
        _refuse_infinite(columns, [names[k] for k in kept], name)
        scales = np.maximum(scales, np.abs(columns).max(axis=0))
        weighted.append(node_weights(nodes[0], frozen) @ columns)
    whole = np.stack(weighted)
    if not signed:
        scales = np.where(whole.sum(axis=(0, 1)) < 0, -scales, scales)
    left = [names[k] for k in range(len(names)) if k not in kept]
    chosen = tuple(texts[k] for k in kept)
    return OwnLibrary(name, chosen, whole / scales, scales, _left_out(name, left))


def expressions(library: Any, name: str) -> tuple[Any, dict[str, str]]:
    """Return a library fitted to five inputs, and the expression of every column by its feature name.

    Raises
    ------
    ValueError
        If a name cannot be read, or two columns have one name.
    """
    fitted = copy.deepcopy(library).fit(np.ones((2, len(INPUTS))))
    found: dict[str, str] = {}
    for text in map(str, fitted.get_feature_names(list(INPUTS))):
        fault = ""
        try:
            written = expression_of(text)
            compile_expression(written, INPUTS, (), arrays=True)
        except ValueError as error:
            fault = str(error)
        if fault or text in found:
            raise ValueError(
                f"library {name}: found the column {text!r}{' twice' * (not fault)}, expected an expression "
                f"in {', '.join(INPUTS)} ({fault or 'of another name'}): name its function, such as "
                'CustomLibrary([f], [lambda v: f"abs({v})"])'
            )
        found[text] = written
    return fitted, found


def expression_of(text: str) -> str:
    """A feature name as an expression.

    Raises
    ------
    ValueError
        If it cannot be read.

    Examples
    --------
    >>> expression_of("|v|^3 T exp(-T / 300)")
    'abs(v) ** 3 * T * exp(-T / 300)'
    """
    return spaced(_PRODUCT.sub(" * ", _ABSOLUTE.sub(r"abs(\1)", text).replace("^", "**")))


def _inputs(nodes: FloatArray) -> FloatArray:
    """Rows of pysindy: v, x, T, F, D in SI units, (nodes, 5); laws see no tension below zero."""
    rows = nodes[[_ROW[name] for name in INPUTS]].T.copy()
    rows[:, INPUTS.index("T")] = np.maximum(rows[:, INPUTS.index("T")], 0.0)
    return np.ascontiguousarray(rows)


def _transformed(fitted: Any, rows: FloatArray) -> FloatArray:
    with np.errstate(all="ignore"):  # what is not a number is refused by name
        return np.asarray(fitted.transform(rows), dtype=np.float64)


def _check_values(name: str, written: str, library: str, rows: FloatArray, values: FloatArray) -> None:
    """Refuse a column whose name does not give its values."""
    _refuse_infinite(values[:, None], [name], library)
    with np.errstate(all="ignore"):
        law = compile_expression(written, INPUTS, (), arrays=True)
        named = np.broadcast_to(law(*rows.T, ()), values.shape)
    wrong = ~(np.abs(named - values) <= _SAME * np.abs(values).max())
    if wrong.any():
        place = int(np.argmax(wrong))
        where = ", ".join(f"{n} = {value:.3g}" for n, value in zip(INPUTS, rows[place], strict=True))
        raise ValueError(
            f"library {library}: found {values[place]:.4g} in the column {name!r} at {where}, expected "
            f"{named[place]:.4g} as it is named: correct the name or the function"
        )


def _is_still(text: str) -> bool:
    """Whether a column is zero while nothing moves; where it is not a number there, the records tell."""
    law = compile_expression(text, INPUTS, (), arrays=True)
    with np.errstate(all="ignore"):
        still = np.broadcast_to(law(0.0, 0.0, np.array(TRIED_TENSIONS), 0.0, 0.0, ()), len(TRIED_TENSIONS))
    known = still[np.isfinite(still)]
    return bool(known.size) and bool(np.abs(known).max() <= AT_REST)


def _refuse_infinite(columns: FloatArray, names: Sequence[str], library: str) -> None:
    bad = ~np.isfinite(columns).all(axis=0)
    if bad.any():
        raise ValueError(
            f"library {library}: found values that are not numbers in the column "
            f"{names[int(np.argmax(bad))]!r}, expected numbers along all motion: keep abs() in fractional "
            "powers and poles away"
        )


def _left_out(library: str, names: Sequence[str]) -> str:
    if not names:
        return ""
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    shown = "; ".join(names[:_SHOWN])
    return f"library {library}: left out columns that are not zero while nothing moves: {shown}{more}"


class _WithoutFunctions(ast.NodeTransformer):
    """Takes out functions whose value has no unit: numbers in their arguments have units of their own."""

    def visit_Call(self, node: ast.Call) -> ast.expr:
        """Put 1 for what has no unit."""
        plain = isinstance(node.func, ast.Name) and node.func.id in ("exp", "log", "tanh", "sign")
        return ast.Constant(1.0) if plain else node


def _factor(text: str) -> str:
    """A column as a factor of a product."""
    top = ast.parse(text, mode="eval").body
    return f"({text})" if isinstance(top, ast.BinOp) and isinstance(top.op, ast.Add | ast.Sub) else text


def _unit(text: str) -> str:
    """Unit of the coefficient of a column, N/s over the column's own."""
    tree = _WithoutFunctions().visit(ast.parse(text, mode="eval").body)
    try:
        powers = dimension_of(ast.unparse(tree), {})
    except ValueError:
        return _UNKNOWN
    return unit_text({s: r - p for s, r, p in zip(("N", "m", "s"), RATE, powers, strict=True)})
