"""Every explainer is found by its name and has the signature of all."""

from __future__ import annotations

from importlib import import_module
from inspect import signature

from discovery.explain.registry import EXPLAINERS

_RESIDUALS = {
    "output-error": "WhitenedResidual",
    "tension": "TensionResidual",
    "force-balance": "ForceBalanceResidual",
}


def test_all_explainers_have_one_signature() -> None:
    for explainer in EXPLAINERS.values():
        first, second = signature(import_module(explainer.module).explain).parameters.values()
        assert first.annotation == _RESIDUALS[explainer.takes]
        assert second.name == "options"
        assert second.annotation == "Options"
