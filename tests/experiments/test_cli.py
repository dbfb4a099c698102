"""The program: exit codes, one line a fault, results whole and at their place, the same numbers anywhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer

from experiments.cli import app
from experiments.rig.rivals import RIVALS
from rom.provenance import program_version
from tests.rom.malformed import MALFORMED, Spoil
from tests.rom.sound_campaign import write_sound_campaign

Boltlaw = Callable[..., Any]
COMMANDS = tuple(
    command.name or command.callback.__name__ for command in app.registered_commands if command.callback
)
PROGRAM = [sys.executable, "-c", "from experiments.cli import main; main()"]


def listing(folder: Path) -> dict[str, tuple[int, int]]:
    """Return every file below a folder with its size and time of change."""
    return {
        str(path.relative_to(folder)): (path.lstat().st_size, path.lstat().st_mtime_ns)
        for path in folder.rglob("*")
    }


def one_line(text: str) -> str:
    """Return the only line of a refusal."""
    (line,) = text.splitlines()
    assert "Traceback" not in line
    return line


@pytest.mark.parametrize("spoil", [spoil for _, spoil in MALFORMED], ids=[name for name, _ in MALFORMED])
def test_a_malformed_campaign_is_refused_in_one_line(spoil: Spoil, tmp_path: Path, boltlaw: Boltlaw) -> None:
    file, *words = spoil(tmp_path / "spoilt")
    before = listing(tmp_path)
    ran = boltlaw("identify", tmp_path / "spoilt", "--jobs", 1)
    assert ran.code == 2
    assert ran.out == ""
    line = one_line(ran.err)
    assert file in line.split(": ")[0]
    assert all(word in line for word in words)
    assert listing(tmp_path) == before


@pytest.mark.parametrize("place", range(0, len(MALFORMED), 40))
def test_the_installed_program_refuses_it_alike(place: int, tmp_path: Path) -> None:
    file, *_ = MALFORMED[place][1](tmp_path / "spoilt")
    before = listing(tmp_path)
    ran = subprocess.run(
        [*PROGRAM, "identify", "spoilt", "--jobs", "2"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 2
    assert ran.stdout == ""
    assert file in one_line(ran.stderr)
    assert listing(tmp_path) == before


def test_predict_refuses_it_too_and_leaves_old_results(
    results: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    _, spoil = MALFORMED[0]
    file, *_ = spoil(tmp_path / "spoilt")
    old = tmp_path / "spoilt-results"
    old.mkdir()
    (old / "prediction.json").write_text("old")
    before = listing(tmp_path)
    ran = boltlaw("predict", results / "model.json", tmp_path / "spoilt")
    assert ran.code == 2
    assert file in one_line(ran.err)
    assert listing(tmp_path) == before


def test_several_faults_take_a_line_each(tmp_path: Path, boltlaw: Boltlaw) -> None:
    write_sound_campaign(tmp_path / "campaign")
    for file in ("records/loosening.h5", "records/free.csv"):
        (tmp_path / "campaign" / file).unlink()
    ran = boltlaw("identify", tmp_path / "campaign", "--jobs", 1)
    assert ran.code == 2
    first, second = ran.err.splitlines()
    assert "records/loosening.h5" in first
    assert "records/free.csv" in second


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("identfy", "campaign"), ("identfy", "identify")),
        (("identify", "campaign", "--job", "2"), ("--job", "--jobs")),
        (("identify",), ("campaign",)),
        (("identify", "campagin"), ("campagin", "nearest", "campaign")),
        (("identify", "nothing-like-it"), ("nothing-like-it", "no such file")),
        (("identify", "campaign", "campaign"), ("unexpected",)),
        (("identify", "campaign", "--jobs", "0"), ("--jobs", "1")),
        (("identify", "campaign", "--jobs", "two"), ("--jobs", "integer")),
        (("identify", "campaign", "--seed", "-1"), ("--seed", "0")),
        (("predict", "modle.json", "campaign"), ("modle.json", "nearest", "model.json")),
        (("predict", "notes.txt", "campaign"), ("notes.txt", "model")),
        (("predict", "other.json", "campaign"), ("other.json", "boltlaw-model/1", "boltlaw-ranking/1")),
        (("report", "empty"), ("empty", "result file")),
        (("report", "emty"), ("emty", "nearest", "empty")),
        (("rig", "campaign"), ("campaign", "exists")),
        (("rig", "new", "--cases", "1"), ("--cases", "2")),
        (("rig", "new", "--cases", "9" * 400), ("--cases", "10000")),
        (("rig", "new", "--noise", "-1"), ("--noise", "0")),
        (("rig", "new", "--noise", "nan"), ("--noise",)),
        (("rig", "new", "--duration-s", "0.2"), ("duration", "0.2", "2.5")),
        (("rig", "new", "--strengths", "1,soft"), ("strengths", "1,soft", "1,0.8,0.6")),
        (("rig", "new", "--strengths", "1,nan"), ("strengths", "nan", "> 0")),
        (("rig", "new", "--law", "power-9"), ("law", "power-9", "power-2", "threshold")),
        (("rig", "new", "--law", "treshold"), ("law", "treshold", "nearest is threshold")),
        (("rig", "new", "--undeclared", "cubic-stifness"), ("cubic-stifness", "'cubic-stiffness'")),
        (("rig", "new", "--undeclared", "hum@sensor:tensoin"), ("sensor:tensoin", "'sensor:tension'")),
        (("rig", "model.json/new", "--cases", "2"), ("model.json: found", "expected a folder")),
        (("run", "empty"), ("empty: found", "expected a file")),
    ],
    ids=" ".join,
)
def test_a_wrong_call_is_answered_in_one_line(
    arguments: tuple[str, ...],
    words: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    boltlaw: Boltlaw,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "campaign").mkdir()
    (tmp_path / "model.json").write_text("{}")
    (tmp_path / "other.json").write_text('{"format": "boltlaw-ranking/1"}')
    (tmp_path / "notes.txt").write_text("no model")
    before = listing(tmp_path)
    ran = boltlaw(*arguments)
    assert ran.code == 2
    assert ran.out == ""
    line = one_line(ran.err)
    assert all(word in line for word in words), line
    assert listing(tmp_path) == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("close", "lab-results"), ("campaign.toml", "nearest campaign is lab")),
        (("discover", "measured"), ("campaign.toml", "nearest campaign is measured/campaign")),
        (("predict", "lab-results", "lab"), ("found a folder", "nearest is lab-results/model.json")),
        (("report", "lab"), ("result file", "nearest is lab-results")),
        (("report", "lab-results/model.json"), ("found a file", "its folder is lab-results")),
    ],
    ids=" ".join,
)
def test_a_wrong_folder_is_answered_with_the_nearest_right_one(
    arguments: tuple[str, ...],
    words: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    boltlaw: Boltlaw,
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("lab", "lab-results", "measured/campaign"):
        (tmp_path / folder).mkdir(parents=True)
    for file in ("lab/campaign.toml", "measured/campaign/campaign.toml", "lab-results/model.json"):
        (tmp_path / file).write_text("")
    before = listing(tmp_path)
    ran = boltlaw(*arguments)
    assert ran.code == 2
    line = one_line(ran.err)
    assert all(word in line for word in words), line
    assert listing(tmp_path) == before


@pytest.mark.parametrize("name", ["a\x1b[31m", "\u202eb", "c" * 3000])
def test_names_cannot_speak_to_the_terminal(name: str, tmp_path: Path, boltlaw: Boltlaw) -> None:
    for arguments in (
        ("identify", tmp_path / name),
        (name, "x"),
        ("import", name, tmp_path),
        ("rig", "--law", name),
    ):
        ran = boltlaw(*arguments)
        assert ran.code == 2
        line = one_line(ran.err)
        assert line.isprintable()
        assert len(line) < 700


def test_without_a_command_the_program_lists_its_commands(boltlaw: Boltlaw) -> None:
    ran = boltlaw()
    assert ran.code == 2
    assert all(re.search(rf"^  {command} ", ran.err, re.MULTILINE) for command in COMMANDS)


@pytest.mark.parametrize("out", ["file", "file/below"])
def test_results_cannot_go_into_a_file(
    out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw
) -> None:
    """It is said before the work, not after it."""
    monkeypatch.setattr("experiments.studies.identify.run", _never)
    monkeypatch.setattr("experiments.studies.reproduce.run", _never)
    write_sound_campaign(tmp_path / "campaign")
    (tmp_path / "file").write_text("mine")
    for command in (("identify", tmp_path / "campaign"), ("reproduce",)):
        ran = boltlaw(*command, "--out", tmp_path / out)
        assert ran.code == 2
        assert str(tmp_path / "file") in one_line(ran.err)
    assert (tmp_path / "file").read_text() == "mine"


def _never(*_: object, **__: object) -> None:
    raise AssertionError("work began")


def test_a_folder_that_may_not_be_written_to_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw
) -> None:
    monkeypatch.setattr("experiments.studies.identify.run", _never)
    monkeypatch.setattr(
        os, "access", lambda _, mode: not mode & os.W_OK
    )  # chmod does not stop an administrator
    write_sound_campaign(tmp_path / "campaign")
    ran = boltlaw("identify", tmp_path / "campaign")
    assert ran.code == 2
    assert re.search(r"campaign-results.*--out", one_line(ran.err))


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_an_example(command: str, boltlaw: Boltlaw) -> None:
    ran = boltlaw(command, "--help")
    assert ran.code == 0
    assert ran.err == ""
    (example,) = re.findall(r"Example: (boltlaw .*(?:\n  .*)*)", ran.out)
    assert example.split()[1] == command
    for option in ("--out", "--seed", "--jobs", "--quiet"):
        assert option in ran.out or (command, option) == ("rig", "--out")


def test_help_names_every_law_that_the_rig_knows(boltlaw: Boltlaw) -> None:
    told = re.sub(r"\s+", "", boltlaw("rig", "--help").out)  # names are broken at hyphens too
    assert [name for name in RIVALS if name not in told] == []


def test_the_version_is_that_of_the_results(boltlaw: Boltlaw) -> None:
    ran = boltlaw("--version")
    assert (ran.code, ran.out, ran.err) == (0, f"boltlaw {program_version()}\n", "")


def test_a_full_disk_is_told_in_one_line_and_old_results_stay(
    results: Path, rig_campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw
) -> None:
    (tmp_path / "prediction.json").write_text("old")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    ran = boltlaw("predict", results / "model.json", rig_campaign, "--out", tmp_path, "--jobs", 1)
    monkeypatch.undo()
    assert ran.code == 2
    assert "No space left" in one_line(ran.err)
    assert [path.name for path in tmp_path.iterdir()] == ["prediction.json"]
    assert (tmp_path / "prediction.json").read_text() == "old"


@pytest.mark.parametrize("error", [RuntimeError("lost"), KeyError("lost"), AssertionError("lost")])
def test_a_fault_of_the_program_is_not_blamed_on_the_input(
    error: Exception, rig_campaign: Path, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw
) -> None:
    monkeypatch.setattr("experiments.studies.identify.run", lambda *_: _throw(error))
    ran = boltlaw("identify", rig_campaign)
    assert ran.code == 1
    assert "Traceback" in ran.err
    assert "lost" in ran.err


def _throw(error: BaseException) -> None:
    raise error


def test_arrays_that_do_not_fit_are_a_fault_of_the_program(
    rig_campaign: Path, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw
) -> None:
    """NumPy raises a ValueError too, but not about the input."""
    import numpy as np

    monkeypatch.setattr("experiments.studies.identify.run", lambda *_: np.ones(2) + np.ones(3))
    ran = boltlaw("identify", rig_campaign)
    assert ran.code == 1
    assert "Traceback" in ran.err
    assert ran.err.splitlines()[-1].startswith("boltlaw: this is a fault of the program")


def test_an_interrupt_is_no_fault(
    rig_campaign: Path, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw
) -> None:
    monkeypatch.setattr("experiments.studies.identify.run", lambda *_: _throw(KeyboardInterrupt()))
    ran = boltlaw("identify", rig_campaign)
    assert ran.code == 130
    assert "interrupted" in one_line(ran.err)


def test_typer_knows_every_command() -> None:
    assert set(COMMANDS) >= {"rig", "identify", "reproduce", "predict", "report"}
    assert set(typer.main.get_command(app).commands) == set(COMMANDS)  # type: ignore[attr-defined]
