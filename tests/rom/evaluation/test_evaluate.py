"""Evaluation of models over a campaign."""

from __future__ import annotations

from pathlib import Path

import pytest

import rom
from rom.campaign.campaign import read_campaign
from rom.evaluation import evaluate


@pytest.mark.parametrize(("jobs", "before"), [(1, 0), (2, 1)])
def test_kernels_are_compiled_before_processes_start(
    rig_campaign: Path, monkeypatch: pytest.MonkeyPatch, jobs: int, before: int
) -> None:
    """Processes that start together would each compile the same filter, and say nothing of it."""
    compiled: list[str] = []
    monkeypatch.setattr(evaluate, "compile_filters", lambda: compiled.append("filters"))
    evaluate.evaluate([rom.paper_model()], read_campaign(rig_campaign), records=[], jobs=jobs)
    assert len(compiled) == before
