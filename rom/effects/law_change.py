"""Changes of the tension law: from the law of a link and a text, another law."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rom.effects.effect import Added
from rom.laws import Law, free_form_law

if TYPE_CHECKING:
    from rom.model import Model

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


def _follow(law: Law) -> ast.expr:
    """How the law's relative rate at a given motion goes with tension, 1 at 100 N; 1 for no loosening."""
    if law.equation == "0":
        return ast.Constant(1.0)
    motion: dict[str, ast.expr] = {name: ast.Constant(value) for name, value in _REFERENCE.items()}
    here = ast.unparse(_replaced(law.equation, motion))
    there = ast.unparse(_replaced(law.equation, {**motion, "T": ast.Constant(_REFERENCE_TENSION)}))
    # a law that does nothing at the reference has no dependence to follow: 0, and no division by it
    return _text(f"abs(({here}) * {_REFERENCE_TENSION} / max(abs({there}) * max(T, 1e-9), 1e-300))")


@dataclass(frozen=True)
class LawChange(Added):
    """A change of the law of a bolt's tension.

    The equation is an expression in what a tension law sees (``T x v F D``), the parameters, ``rate``, which
    is the rate of the law that is changed, and ``follow``, its relative rate at a given motion as a function
    of tension, 1 at 100 N: ``follow ** 0`` leaves a rate proportional to T, ``follow ** 1`` lets it depend on
    tension as the law itself does. Of several changes each sees the law that those before it left.
    """

    def changed(self, law: Law) -> Law:
        """The changed law, an ordinary tension law that keeps the parameters of the first one.

        Raises
        ------
        ValueError
            If both have a parameter of one name.
        """
        clash = sorted(set(law.parameters) & set(self.parameters))
        if clash:
            raise ValueError(f"law {law.name!r} must not have the parameters of {self.name!r}, got {clash}")
        names = {"rate": _text(law.equation), "follow": _follow(law)}
        equation = ast.unparse(_replaced(self.equation, names))
        parameters = {**law.parameters, **self.parameters}
        return free_form_law(f"{law.name} + {self.name}", equation, "tension rate", parameters)

    def added_to(self, model: Model) -> Model:
        """The model with its bolted link's tension law changed.

        Raises
        ------
        ValueError
            If the model has no bolted link.
        """
        link = _bolted(model)
        laws = model.link_laws[link]
        assert laws.tension_rate is not None
        changed = replace(laws, tension_rate=self.changed(laws.tension_rate))
        return replace(model, link_laws={**model.link_laws, link: changed})

    def paths(self, model: Model) -> Mapping[str, str]:
        """Where a model whose law is changed has the parameters, by name."""
        return {name: f"{_bolted(model)}.tension_rate.{name}" for name in self.parameters}


def _bolted(model: Model) -> str:
    if not model.structure.bolted_links:
        raise ValueError("a change of the tension law needs a bolted link, the model has none")
    return model.structure.bolted_links[0]
