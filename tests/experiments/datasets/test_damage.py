"""Damaged files and maps through every reader: read, or refused in a line; nothing is half-written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments.cli import run
from experiments.datasets.collected import SourceError
from experiments.datasets.laboratory import FORMATS, signals_of
from tests.experiments.datasets.damaged_files import KINDS, damaged, sound
from tests.experiments.datasets.lab_case import CHANNELS, map_of

INPUTS_A_SEED = 8  # of each kind of file


def faults_of(path: Path, form: str) -> tuple[str, ...]:
    """Return the one line of a refusal, if there is one."""
    try:
        signals_of(path, form, [])
    except SourceError as refused:
        (line,) = refused.faults
        return (line,)
    return ()


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_read_or_refused(
    kind: str, request: pytest.FixtureRequest, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    form, ending, _ = KINDS[kind]
    random = np.random.default_rng(list(KINDS).index(kind))
    path = tmp_path / f"a{ending}"
    for number in range(INPUTS_A_SEED * request.config.getoption("--seeds")):
        path.write_bytes(sound(kind) if number == 0 else damaged(sound(kind), random))
        assert all(fault.startswith(path.name) for fault in faults_of(path, form)), f"input {number}"
    told = capfd.readouterr()
    assert (told.out, told.err) == ("", "")


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_leaves_nothing_half_written(
    kind: str, request: pytest.FixtureRequest, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    form, ending, _ = KINDS[kind]
    random = np.random.default_rng(100 + list(KINDS).index(kind))
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "import.toml").write_text(map_of(ending[1:], CHANNELS))
    path = tmp_path / "lab" / f"a{ending}"
    for number in range(INPUTS_A_SEED * request.config.getoption("--seeds") // 6):
        path.write_bytes(damaged(sound(kind), random))
        new = tmp_path / f"new{number}"
        before = set(tmp_path.rglob("*"))
        code = run(["import", form, str(tmp_path / "lab"), str(new), "--jobs", "1", "--quiet"])
        told = capfd.readouterr()
        assert code in (0, 2), told.err
        assert "Traceback" not in told.err
        assert code == 0 or (told.err.strip() and set(tmp_path.rglob("*")) == before)


def test_a_damaged_map_is_refused(
    request: pytest.FixtureRequest, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    random = np.random.default_rng(7)
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "a.csv").write_bytes(sound("csv"))
    raw = map_of("csv", {**CHANNELS, "time": '{channel = "time", unit = "s"}'}).encode()
    for number in range(INPUTS_A_SEED * request.config.getoption("--seeds")):
        (tmp_path / "lab" / "import.toml").write_bytes(damaged(raw, random))
        before = set(tmp_path.rglob("*"))
        code = run(["import", "csv", str(tmp_path / "lab"), str(tmp_path / f"new{number}"), "--jobs", "1"])
        told = capfd.readouterr()
        assert code in (0, 2), told.err
        assert code == 0 or (told.err.strip() and set(tmp_path.rglob("*")) == before)


def test_every_format_is_damaged() -> None:
    assert {form for form, _, _ in KINDS.values()} == set(FORMATS)
