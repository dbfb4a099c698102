"""Displacements too noisy to be differentiated twice: records are simulated, no forces balanced."""

from __future__ import annotations

from pathlib import Path

import pytest

from discovery.loop.close_loop import refits_of
from discovery.loop.free_refits import FreeRefits
from discovery.options import Options
from tests.discovery.driven_twins import driven


def test_noise_that_spoils_a_balance_asks_for_simulation(tmp_path: Path) -> None:
    refits = refits_of(driven(tmp_path / "noisy", noise_m=6e-4, seconds=2.0), Options())
    assert isinstance(refits, FreeRefits)
    stiffness = refits.start().model.parameter("guide.stiffness.k")
    assert stiffness.value == pytest.approx(8000.0, rel=0.01)


def test_quiet_displacements_are_balanced(tmp_path: Path) -> None:
    assert not isinstance(refits_of(driven(tmp_path / "quiet", seconds=2.0), Options()), FreeRefits)
