"""Every explainer is found by its name and has the signature of all."""

from __future__ import annotations

from importlib import import_module
from inspect import signature
from types import SimpleNamespace
from typing import get_args

import pytest

from discovery.explain.registry import EXPLAINERS
from discovery.options import Options
from discovery.residual.at_rest import RestResidual
from discovery.residual.base import Kind
from discovery.residual.force_balance import ForceBalanceResidual
from discovery.residual.output_error import WhitenedResidual
from discovery.residual.simulation import SimulationResidual
from discovery.residual.tension import TensionResidual

_RESIDUALS = {
    one.kind: one.__name__
    for one in (WhitenedResidual, TensionResidual, ForceBalanceResidual, SimulationResidual, RestResidual)
}
_OTHERS = [
    (name, kind)
    for name, explainer in EXPLAINERS.items()
    for kind in get_args(Kind)
    if kind != explainer.takes
]


def test_all_explainers_have_one_signature() -> None:
    for explainer in EXPLAINERS.values():
        first, second = signature(import_module(explainer.module).explain).parameters.values()
        assert first.annotation == _RESIDUALS[explainer.takes]
        assert second.name == "options"
        assert second.annotation == "Options"


def test_every_kind_of_residual_has_an_explainer() -> None:
    assert {explainer.takes for explainer in EXPLAINERS.values()} == set(_RESIDUALS) == set(get_args(Kind))


@pytest.mark.parametrize(("name", "kind"), _OTHERS)
def test_an_explainer_explains_nothing_of_a_residual_of_another_kind(name: str, kind: Kind) -> None:
    explainer, other = EXPLAINERS[name], SimpleNamespace(kind=kind)
    assert explainer(other, Options()) == ()
    with pytest.raises(AttributeError):  # it would look at one of its own kind
        explainer(SimpleNamespace(kind=explainer.takes), Options())
