"""The closed loop in a declared band: a mode above it is nothing that is missing."""

from __future__ import annotations

from pathlib import Path

import pytest

from discovery.loop.close_loop import close_loop
from tests.rom.lumped_hidden import STIFFNESS, with_hidden_mode


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.parametrize(
    ("test", "kind"),
    [
        ("driven", "displacement"),
        pytest.param("free", "acceleration", marks=pytest.mark.variant),
        pytest.param("coupled", "acceleration", marks=pytest.mark.variant),
    ],
)
def test_a_hidden_mode_is_found_without_a_band_alone(tmp_path: Path, test: str, kind: str) -> None:
    without = close_loop(with_hidden_mode(tmp_path / "none", test, kind, False, known=test == "free"))
    assert without.verdict == ("closed" if test == "coupled" else "unexplained")  # by an effect, extra-mode
    within = close_loop(with_hidden_mode(tmp_path / "band", test, kind, True, known=test == "free"))
    assert within.verdict == "no-effect"
    number = within.model.parameter("s.stiffness.k")
    assert number.value == pytest.approx(STIFFNESS, rel=4e-3)
    before, after = (one.steps[0].errors["hold_out"]["motion_nrmse"] for one in (without, within))
    assert before is not None
    assert after is not None
    assert after < before / 2
