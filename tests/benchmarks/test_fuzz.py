"""The fuzz of readers and commands: a few of its inputs, and that it sees what it is made to see."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from benchmarks import fuzz
from benchmarks.fuzz_inputs import Input, input_of, spoilt
from tests.rom.sound_campaign import write_sound_campaign

KINDS = ("file csv", "file uff", "map", "settings of every test", "record", "laws", "experiment", "call")


@pytest.fixture
def sound(tmp_path: Path) -> Path:
    write_sound_campaign(tmp_path / "sound" / "campaigns" / "every")
    return tmp_path / "sound"


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_inputs_are_read_or_refused(kind: str, sound: Path, tmp_path: Path) -> None:
    for number in range(2):
        folder = tmp_path / str(number)
        folder.mkdir()
        ended, wrong = fuzz.judged(input_of(sound, folder, 0, number, kind), folder)
        assert not wrong, ended.err


def test_an_input_is_that_of_its_seed_and_number(sound: Path, tmp_path: Path) -> None:
    made = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        made.append((input_of(sound, tmp_path / name, 3, 5, "map"), fuzz.contents(tmp_path / name)))
    assert made[0] == made[1]


def _fails(_: list[str]) -> int:
    print("Traceback (most recent call last):", file=sys.stderr)
    return 1


def _writes(_: list[str]) -> int:
    Path("half.json").write_text("{")
    print("no such thing", file=sys.stderr)
    return 2


def _loses(_: list[str]) -> int:
    Path("input").write_text("other")
    Path("result.json").write_text(json.dumps({"a": float("nan")}))
    Path(".scratch").mkdir()
    return 0


def _waits(_: list[str]) -> int:
    time.sleep(60)
    return 0


def _dies(_: list[str]) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


@pytest.mark.parametrize(
    ("program", "expected"),
    [
        (_fails, ["code 1", '"Traceback" on standard error']),
        (_writes, ["refused, and yet written: half.json", "half.json is no strict JSON"]),
        (lambda _: 2, ["refused without a word"]),
        (lambda _: print("a\x1b[31mb", file=sys.stderr) or 2, ["a line that cannot be printed"]),
        (_loses, ["changed or lost: input", "left over: .scratch", "result.json is no strict JSON: NaN"]),
        (_waits, ["no end within 0.5 s"]),
        (_dies, ["code -9"]),
    ],
)
def test_what_goes_wrong_is_seen(
    program: Callable[[list[str]], int], expected: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuzz, "run", program)
    (tmp_path / "input").write_text("as it was")
    _, wrong = fuzz.judged(Input("any", ()), tmp_path, 0.5)
    assert len(wrong) == len(expected)
    assert all(any(line.startswith(words) for line in wrong) for words in expected)


def test_a_value_is_spoilt_in_one_place() -> None:
    content = {"a": [1, 2, {"b": "text"}], "c": {"d": 0.5}}
    before = json.dumps(content)
    found = {json.dumps(spoilt(content, Random(seed))[0], default=str) for seed in range(40)}
    assert len(found) > 30
    assert json.dumps(content) == before
