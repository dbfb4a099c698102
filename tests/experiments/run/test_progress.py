"""Bars say how long the rest takes as soon as the total is known: before the first part of the work."""

from __future__ import annotations

import io
from pathlib import Path
from time import sleep

from numba import njit, types
from numba.extending import overload
from rich.console import Console

from experiments.run.progress import progress_bars
from rom.campaign.campaign import read_campaign
from rom.progress import counted
from tests.rom.sound_campaign import write_sound_campaign


def test_the_total_is_known_before_the_first_part_is_done(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    write_sound_campaign(tmp_path / "campaign")
    campaign = read_campaign(tmp_path / "campaign", 1, lambda *now: told.append(now))
    count = len(campaign.settings.record)
    assert told == [(done, count) for done in range(count + 1)]
    told.clear()
    assert next(counted(["first", "second"], 2, lambda *now: told.append(now))) == "first"
    assert told == [(0, 2)]


def test_a_stage_that_knows_no_total_shows_its_time_and_no_question_mark() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=100)
    with progress_bars(False, console) as report:
        report("identifying")
        move = report("fitting effects")
        assert move is not None
        move(1, 40)
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert "0:00:00" in shown
    assert "1/40" in shown
    assert "?" not in shown.replace("[?25", "")


def test_a_stage_that_knows_its_total_shows_the_time_that_is_left() -> None:
    now = [0.0]
    console = Console(file=io.StringIO(), force_terminal=True, width=100, get_time=lambda: now[0])
    with progress_bars(False, console) as report:
        move = report("fitting effects")
        assert move is not None
        for done in range(11):
            now[0] = 2.0 * done
            move(done, 40)
    assert "0:01:00" in console.file.getvalue()  # type: ignore[attr-defined]


def _wait() -> None:
    sleep(0.3)  # the bars are drawn ten times a second


@overload(_wait)
def _compiled_wait() -> object:
    _wait()
    return lambda: None


def test_a_stage_says_that_it_compiles_while_it_does() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=100)
    with progress_bars(False, console) as report:
        report("identifying")
        sleep(0.3)
        before = console.file.getvalue()  # type: ignore[attr-defined]
        njit(types.void())(lambda: _wait())
        during = console.file.getvalue().removeprefix(before)  # type: ignore[attr-defined]
        sleep(0.3)
    after = console.file.getvalue().removeprefix(before + during)  # type: ignore[attr-defined]
    assert ["compiling once" in shown for shown in (before, during, after[-200:])] == [False, True, False]
