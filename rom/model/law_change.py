"""Changes of the tension law: from the law of a link and a text, another law."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache

from rom.model.effect import ModelCorrection
from rom.model.laws import Law, free_form_law

# where a law is compared with itself over tension, and the motion at which it is
_REFERENCE = {"v": 0.05, "x": 1e-4, "F": 100.0, "D": 10.0}
_REFERENCE_TENSION = 100.0


class _Replaced(ast.NodeTransformer):
    def __init__(self, names: dict[str, ast.expr]) -> None:
        self.names = names

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self.names.get(node.id, node)


def _replaced(text: str, names: dict[str, ast.expr]) -> ast.expr:
    """An expression with names replaced by expressions."""
    tree = _Replaced(names).visit(ast.parse(text, mode="eval").body)
    assert isinstance(tree, ast.expr)
    return tree


def _text(text: str) -> ast.expr:
    return ast.parse(text, mode="eval").body


def _follow(law: str) -> ast.expr:
    """How a law's relative rate at a given motion goes with tension, 1 at 100 N; 1 for no loosening."""
    if law == "0":
        return ast.Constant(1.0)
    motion: dict[str, ast.expr] = {name: ast.Constant(value) for name, value in _REFERENCE.items()}
    here = ast.unparse(_replaced(law, motion))
    there = ast.unparse(_replaced(law, {**motion, "T": ast.Constant(_REFERENCE_TENSION)}))
    # a law that does nothing at the reference has no dependence to follow: 0, and no division by it
    return _text(f"abs(({here}) * {_REFERENCE_TENSION} / max(abs({there}) * max(T, 1e-9), 1e-300))")


@dataclass(frozen=True)
class LawChange(ModelCorrection):
    """A change of the law of a bolt's tension; the kernels see the changed law alone.

    The equation is an expression in what a tension law sees (``T x v F D``), the parameters, ``rate``, which
    is the rate of the law that is changed, and ``follow``, its relative rate at a given motion as a function
    of tension, 1 at 100 N: ``follow ** 0`` leaves a rate proportional to T, ``follow ** 1`` lets it depend on
    tension as the law itself does. Of several changes each sees the rate that those before it left, and
    follows the law that none has changed.
    """

    kind = "law change"

    @property
    def adds(self) -> bool:
        """Whether the change is a rate of its own beside the law's, not a factor on it."""
        body = _text(self.equation)
        return isinstance(body, ast.BinOp) and isinstance(body.op, ast.Add | ast.Sub)

    def changed(self, law: Law, prefix: str = "", first: Law | None = None) -> Law:
        """The changed law, an ordinary tension law that keeps the parameters of the first one.

        Parameters
        ----------
        law : Law
            A tension law.
        prefix : str
            Put before the names of the change's own parameters.
        first : Law
            The law before all changes; ``law`` if not given.

        Raises
        ------
        ValueError
            If both have a parameter of one name, or the equation is more than arithmetic.
        """
        own = {prefix + name: value for name, value in self.parameters.items()}
        clash = sorted(set(law.parameters) & set(own))
        if clash:
            raise ValueError(f"law {law.name!r} must not have the parameters of {self.name!r}, got {clash}")
        equation = _changed(
            self.equation, law.equation, (first or law).equation, tuple(self.parameters), prefix
        )
        return free_form_law(f"{law.name} + {self.name}", equation, "tension rate", {**law.parameters, **own})


@cache
def _changed(change: str, law: str, first: str, parameters: tuple[str, ...], prefix: str) -> str:
    names: dict[str, ast.expr] = {name: ast.Name(prefix + name, ast.Load()) for name in parameters}
    return ast.unparse(_replaced(change, {**names, "rate": _text(law), "follow": _follow(first)}))


def prefix_of(change: ModelCorrection) -> str:
    """What stands before the names of a change's parameters in the changed law."""
    return f"{change.name.replace('-', '_')}_"


def change_law(law: Law, changes: Iterable[LawChange]) -> tuple[Law, Mapping[str, str]]:
    """A tension law after all changes, and the names of their parameters in it by path in the model."""
    names: dict[str, str] = {}
    first = law
    for change in changes:
        prefix = prefix_of(change)
        law = change.changed(law, prefix, first)
        names |= {f"{change.path}.{name}": prefix + name for name in change.parameters}
    return law, names
