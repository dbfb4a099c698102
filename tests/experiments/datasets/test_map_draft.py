"""A drafted map names signals, units, rates and files; what is left open is refused until it is completed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.datasets.map_draft import _quantity
from experiments.datasets.signals import Signal
from rom.campaign.campaign import read_campaign
from tests.conftest import Boltlaw


def table(path: Path, heads: str) -> None:
    time = np.arange(4000) / 2000.0
    columns = [time, *(np.sin((k + 1) * time) for k in range(heads.count(",")))]
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, np.transpose(columns), "%.6f", ",", header=heads, comments="")


def test_a_draft_is_refused_until_it_is_completed_and_is_then_a_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw
) -> None:
    monkeypatch.chdir(tmp_path)
    table(Path("lab/sine_driven.csv"), "Time (s),Shaker force (kN),Acc LO (g),Remark")
    table(Path("lab/later/x.csv"), "Time (s),Shaker force (kN),Acc LO (g),Remark")
    ran = boltlaw("import", "csv", "lab")
    assert (ran.code, ran.err) == (0, "")
    assert "then: boltlaw import csv lab NEW_DIR" in ran.out
    path = Path("lab/import.toml")
    text = path.read_text(encoding="utf-8")
    for line in (
        '"Shaker force (kN)" = "force_BODY"   # NEEDED: of which body; [kN]',
        '"Acc LO (g)" = "acceleration_BODY"   # NEEDED: of which body; [g]',
        "motion_rate_hz = 2000",
        'file = "sine_driven.csv"\ntest = "driven"',
        'file = "later/x.csv"\n# test = "loosening"   # NEEDED',
    ):
        assert line in text
    assert '"Time (s)"' not in text
    ran = boltlaw("import", "csv", "lab", "new")
    assert (ran.code, ran.out) == (2, "")
    assert "record[0].test: found nothing" in ran.err
    completed = (
        text.replace("BODY", "lo")
        .replace("0.5   #", "0.0   #")
        .replace('# test = "loosening"', 'test = "driven"')
    )
    path.write_text(completed, encoding="utf-8")
    ran = boltlaw("import", "csv", "lab", "new")
    assert ran.code == 0, ran.err
    campaign = read_campaign("new")
    record = campaign.load(campaign.select("driven")[0])
    assert np.abs(record.channels["force_lo"].samples).max() == pytest.approx(1000.0, rel=1e-3)
    assert boltlaw("import", "csv", "lab").code == 2  # a map that is there stays
    assert path.read_text(encoding="utf-8") == completed


@pytest.mark.parametrize(
    ("name", "unit", "quantity"),
    [
        ("Hammer", "N", "force"),
        ("Bolt force", "kN", "tension"),
        ("Schraubenkraft", "kN", "tension"),
        ("Bolt", "V/V", "strain"),
        ("CH3", "m/s2", "acceleration"),
        ("CH4", "mm", "displacement"),
        ("beschl_so", "", "acceleration"),
        ("CH5", "", None),
        ("Temperature", "degC", None),
    ],
)
def test_unit_comes_before_name(name: str, unit: str, quantity: str | None) -> None:
    samples: Any = np.zeros(3)
    assert _quantity(Signal(name, samples, unit)) == quantity


def test_a_public_set_needs_no_map(tmp_path: Path, boltlaw: Boltlaw) -> None:
    ran = boltlaw("import", "emps", tmp_path)
    assert ran.code == 2
    assert "expected SOURCE and NEW_DIR" in ran.err
