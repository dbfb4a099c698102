"""Bad days: full disks, interrupts, killed processes, two runs at once, records that change under way."""

from __future__ import annotations

import errno
import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from experiments.run.publication import LOCK, MADE, MAKING, BusyError, finish, results_into
from rom.campaign.record import write_channels
from rom.parameters.he_2025 import paper_model
from tests.rom.sound_campaign import UNCOUPLED, sound_channels, write_sound_campaign

Boltlaw = Callable[..., Any]
REPOSITORY = Path(__file__).parents[3]
PATIENCE_S = 120.0
OLD = {"closure.json": "old", "model.json": "old", "mine.txt": "mine"}

# `boltlaw close` of a closure made by hand; after so many figures it says so and waits to be ended
RUN = """
import signal, sys, time
import discovery, experiments.studies.identify as identify
from experiments.cli import main
from experiments.figures import style
from tests.discovery.sound_closure import closure
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it for what runs behind it
discovery.close_loop = lambda *_, **__: closure(verdict="no-effect")
save, left = style.save, int(sys.argv[3])
def waiting(figure, path):
    global left
    left -= 1
    if left == 0:
        print("under way", flush=True)
        time.sleep(300)
    return save(figure, path)
style.save = waiting
sys.argv[1:] = ["close", sys.argv[1], "--out", sys.argv[2], "--jobs", "1", "--quiet"]
main()
"""


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    write_sound_campaign(tmp_path / "campaign")
    return tmp_path / "campaign"


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A folder with results of an earlier run, and a file of somebody's own."""
    folder = tmp_path / "out"
    folder.mkdir()
    for name, text in OLD.items():
        (folder / name).write_text(text)
    return folder


def held(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text(errors="replace") for path in folder.iterdir()}


def started(campaign: Path, out: Path, figures: int, **options: Any) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", RUN, str(campaign), str(out), str(figures)],
        cwd=REPOSITORY, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options,
    )  # fmt: skip


@pytest.fixture
def scratch(tmp_path: Path) -> Path:
    """Where a run has its temporary files."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    return folder


@pytest.fixture
def under_way(campaign: Path, out: Path, scratch: Path) -> Iterator[subprocess.Popen[str]]:
    """A run that has written one figure and waits."""
    run = started(campaign, out, 2, env={**os.environ, "TMPDIR": str(scratch)})
    assert run.stdout is not None
    try:
        assert run.stdout.readline() == "under way\n"
        yield run
    finally:
        run.kill()
        run.communicate()


def whole(out: Path) -> bool:
    """Whether the folder holds all of one new run, and nothing but that and what was somebody's own."""
    names = set(held(out))
    figures = {name for name in names if name.endswith((".svg", ".pdf"))}
    data = json.loads((out / "closure.json").read_text())
    model = json.loads((out / "model.json").read_text())
    assert data["campaign_digest"] == model["identification"]["campaign_digest"]
    assert len(figures) >= 2
    return names == {"closure.json", "model.json", "mine.txt", *figures} and held(out)["mine.txt"] == "mine"


@pytest.mark.parametrize(
    ("by", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_a_run_that_is_ended_leaves_earlier_results_and_nothing_else(
    under_way: subprocess.Popen[str], out: Path, scratch: Path, by: signal.Signals, code: int, word: str
) -> None:
    assert list(scratch.iterdir())
    under_way.send_signal(by)
    _, err = under_way.communicate(timeout=PATIENCE_S)
    assert under_way.returncode == code
    assert err.splitlines() == [f"{word}: no result is half-written, earlier ones are as they were"]
    assert held(out) == OLD
    assert list(scratch.iterdir()) == []


def test_a_killed_run_leaves_earlier_results_and_the_next_one_starts_again(
    under_way: subprocess.Popen[str], campaign: Path, out: Path
) -> None:
    second = started(campaign, out, 0)
    _, err = second.communicate(timeout=PATIENCE_S)
    assert second.returncode == 2  # the first one holds the folder
    (line,) = err.splitlines()
    assert "another run" in line
    under_way.kill()
    under_way.wait()
    assert {name: text for name, text in OLD.items() if (out / name).read_text() == text} == OLD
    again = started(campaign, out, 0)
    _, err = again.communicate(timeout=PATIENCE_S)
    assert (again.returncode, err) == (0, "")
    assert whole(out)


def test_a_limit_of_the_system_is_told_in_a_line_and_old_results_stay(campaign: Path, out: Path) -> None:
    """No file may be longer than 20 kB: what a full disk does, by the system itself."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    run = started(campaign, out, 0, preexec_fn=limited)
    _, err = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 2
    (line,) = err.splitlines()
    assert f'found "{os.strerror(errno.EFBIG)}", expected room for what is written' in line
    assert held(out) == OLD


@pytest.mark.parametrize("written", range(4))
def test_a_disk_that_fills_up_at_any_file_changes_nothing(
    written: int, campaign: Path, out: Path, boltlaw: Boltlaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two result files and figures."""
    import discovery
    from tests.discovery.sound_closure import closure

    move, left = Path.replace, written

    def filling(path: Path, target: Path) -> Path:
        nonlocal left
        left -= 1
        if left < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return move(path, target)

    monkeypatch.setitem(vars(discovery), "close_loop", lambda *_, **__: closure(verdict="no-effect"))
    monkeypatch.setattr(Path, "replace", filling)
    ran = boltlaw("close", campaign, "--out", out, "--jobs", 1, figures=True)
    assert (ran.code, ran.out) == (2, "")
    (line,) = ran.err.splitlines()
    assert (
        line
        == 'found "No space left on device", expected room for what is written: free some, or name '
        + ("another folder with --out")
    )
    assert held(out) == OLD


def written(folder: Path, **files: str) -> None:
    with results_into(folder) as new:
        for name, text in files.items():
            (new / name).write_text(text)


def test_results_take_their_places_together(out: Path) -> None:
    written(out, a="1", b="2")
    assert held(out) == OLD | {"a": "1", "b": "2"}


def test_nothing_comes_of_a_run_that_fails_not_even_a_folder(tmp_path: Path) -> None:
    with pytest.raises(TypeError):
        written(tmp_path / "a" / "b", first="half", second=1)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_a_run_that_ends_while_files_take_their_places_is_completed(
    error: type[BaseException], out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    move = Path.replace

    def once(path: Path, target: Path) -> Path:
        if path.name == "model.json":
            monkeypatch.undo()
            raise error
        return move(path, target)

    new = {"closure.json": "new", "model.json": "new"}
    monkeypatch.setattr(Path, "replace", once)
    with pytest.raises(error):
        written(out, **new)
    finish(out)
    assert held(out) == OLD | new


def test_what_a_killed_run_had_finished_is_there_after_the_next_one(out: Path) -> None:
    for name in (MADE, MAKING):
        (out / name).mkdir()
        (out / name / f"from{name}").write_text("new")
    (out / LOCK).touch()
    written(out, other="new")
    assert held(out) == OLD | {f"from{MADE}": "new", "other": "new"}


def test_a_report_shows_what_a_killed_run_had_finished(out: Path, boltlaw: Boltlaw) -> None:
    (out / MADE).mkdir()
    for path in (out / "closure.json", out / "model.json"):
        path.unlink()
    result = {"format": "boltlaw-prediction/1", "campaign": "of the killed run", "records": [], "errors": {}}
    (out / MADE / "prediction.json").write_text(json.dumps(result))
    assert boltlaw("report", out).code == 0
    assert "of the killed run" in (out / "report.html").read_text()
    assert not (out / MADE).exists()


def test_one_run_at_a_time_in_a_folder_and_others_elsewhere(out: Path, tmp_path: Path) -> None:
    with results_into(out) as new:
        with pytest.raises(BusyError, match="another run"):
            written(out, a="second")
        written(tmp_path / "elsewhere", a="1")
        (new / "a").write_text("first")
    assert held(out) == OLD | {"a": "first"}
    written(out, a="third")
    assert held(out) == OLD | {"a": "third"}


def test_who_waits_for_the_lock_of_an_ended_run_gets_a_new_one(out: Path) -> None:
    """The file of the lock goes with the run: its name must never stand for two locks."""
    with results_into(out):
        assert (out / LOCK).exists()
    assert not (out / LOCK).exists()


@pytest.mark.parametrize("change", ["other bytes", "gone"])
@pytest.mark.parametrize("command", ["identify", "predict"])
def test_a_record_that_changes_under_way_is_told_and_nothing_is_written(
    change: str, command: str, campaign: Path, tmp_path: Path, boltlaw: Boltlaw,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """After the check, before it is read again."""
    from rom.campaign import campaign as reader

    record, read = campaign / UNCOUPLED, reader.read_channels

    def changing(path: Path, *rates: float) -> Any:
        if change == "gone":
            record.unlink(missing_ok=True)
        else:
            channels = {
                name: replace(c, samples=c.samples + 1e-9) for name, c in sound_channels(UNCOUPLED).items()
            }
            write_channels(record, channels)
        return read(path, *rates)

    paper_model().save(tmp_path / "model.json")
    monkeypatch.setattr(reader, "read_channels", changing)
    words = (tmp_path / "model.json", campaign) if command == "predict" else (campaign,)
    ran = boltlaw(command, *words, "--out", tmp_path / "results", "--jobs", 1)
    assert ran.code == 2, ran.err
    (line,) = ran.err.splitlines()
    assert UNCOUPLED in line
    assert ("no such file" if change == "gone" else "other content") in line
    assert not (tmp_path / "results").exists()


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder in which not even root may write")
def test_a_folder_in_which_nothing_can_be_made_is_refused_before_the_work(
    campaign: Path, boltlaw: Boltlaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    import discovery

    monkeypatch.setitem(vars(discovery), "close_loop", lambda *_, **__: pytest.fail("work began"))
    ran = boltlaw("close", campaign, "--out", "/proc/self/results", "--jobs", 1)
    assert (ran.code, ran.out) == (2, "")
    (line,) = ran.err.splitlines()
    assert "/proc/self/results" in line
