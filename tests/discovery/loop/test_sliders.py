"""A slider hidden in the link of a driven body is named, whatever the size, and not a rounded form of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from discovery.loop.close_loop import close_loop
from tests.discovery import slider_twins as twins

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("quantity", "size_m"), [("displacement", 1e-7), ("velocity", 1e-3)])
def test_a_slider_is_named_at_any_size(tmp_path: Path, quantity: str, size_m: float) -> None:
    closure = close_loop(twins.driven(tmp_path / "c", quantity, size_m), jobs=1)
    assert closure.verdict == "closed"
    (found,) = closure.effects
    assert found.effect.path == "s.jenkins-slip"
    numbers, spring = found.effect.parameters, closure.model.parameter("s.stiffness.k").value
    slip_m = numbers["F_s"].value / (numbers["kappa"].value * spring)
    assert numbers["kappa"].value == pytest.approx(twins.SHARE, rel=0.05)
    assert slip_m == pytest.approx(twins.SLIP * size_m, rel=0.05)
