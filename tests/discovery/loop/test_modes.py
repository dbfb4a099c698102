"""The closed loop on modes of a beam: a cubic spring hidden in one of them, and nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from discovery.loop.close_loop import close_loop
from tests.rom import beams

CUBIC = 3e5  # [N/m3]: a twentieth of the first mode's stiffness and more, at the amplitudes of the records


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
def test_nothing_is_found_where_modes_lack_nothing(tmp_path: Path) -> None:
    found = close_loop(beams.campaign(tmp_path / "clean", each=1))
    assert found.verdict == "no-effect"
    assert set(found.model.structure.body_names) == {"mode_1", "mode_2"}


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
def test_a_cubic_spring_in_one_mode_is_found_there(tmp_path: Path) -> None:
    found = close_loop(beams.campaign(tmp_path / "cubic", cubic=(CUBIC, 0.0, 0.0), each=1))
    first = found.effects[0].effect
    assert (first.name, first.enters) == ("cubic-stiffness", "mode_1")
    assert first.parameters["k3"].value == pytest.approx(CUBIC, rel=0.02)
    before, after = (found.steps[k].errors["hold_out"]["motion_nrmse"] for k in (0, -1))
    assert before is not None
    assert after is not None
    assert after < before / 3
