"""Structures with a mode above the declared band that the declared model does not have."""

from __future__ import annotations

from pathlib import Path

import pytest

import rom
from rom.evaluation.error_measures import summarise
from rom.evaluation.evaluate import evaluate
from tests.rom.lumped_hidden import DAMPING, HIDDEN, MASS, STIFFNESS, with_hidden_mode


def identified(folder: Path, test: str, kind: str, band: bool) -> tuple[dict[str, float], float]:
    """Numbers relative to the truth less one, and the held-out error: none where no simulation ends."""
    found = with_hidden_mode(folder, test, kind, band, known=test == "free")
    model = rom.identify(found)
    judged = evaluate([model], found, found.select(hold_out=True))
    error = summarise(one.comparisons[0] for one in judged)["motion_nrmse"]
    truth = {"body.m.mass": MASS + HIDDEN, "s.stiffness.k": STIFFNESS, "s.damping.c": DAMPING}
    off = {path: model.parameter(path).value / value - 1 for path, value in truth.items()}
    return off, float("inf") if error is None else error


@pytest.mark.parametrize(
    ("test", "kind", "gain"),
    [
        ("driven", "displacement", 5.0),
        ("driven", "acceleration", 5.0),
        ("free", "acceleration", 2.0),
        ("coupled", "acceleration", 1.2),
    ],
)
def test_a_band_below_a_hidden_mode(tmp_path: Path, test: str, kind: str, gain: float) -> None:
    """In the band the hidden body is a mass: its own resonance adds less than 0.4 % of the whole there."""
    off, error = identified(tmp_path / "band", test, kind, True)
    assert abs(off["body.m.mass"]) < 4e-3
    assert abs(off["s.stiffness.k"]) < 4e-3
    assert abs(off["s.damping.c"]) < 0.02
    _, without = identified(tmp_path / "none", test, kind, False)
    assert without > gain * error


def test_lines_of_the_fit_lie_in_the_band(tmp_path: Path) -> None:
    from rom.identification.record_spectra import spectral_records
    from rom.signals.measured_records import measured_record
    from tests.rom.lumped_hidden import BAND

    found = with_hidden_mode(tmp_path / "c", "coupled", "acceleration", True)
    for settings in found.settings.record:
        parts = spectral_records(measured_record(found, settings).measurement, found.settings)
        lines = [float(f) for part in parts for f in (part.frequency[0], part.frequency[-1])]
        assert BAND["low_hz"] <= min(lines) < max(lines) <= BAND["high_hz"]
