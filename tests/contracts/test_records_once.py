"""How often a record is read, assessed and processed while one command works on its campaign."""

from __future__ import annotations

import os
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

import discovery
import rom
from experiments.run.execution import execution
from rom.campaign.campaign import Campaign, Record, RecordSettings
from rom.campaign.record import RecordError
from rom.signals import measured_records
from rom.signals.measured_records import (
    NothingLeftError,
    judged_by,
    measured_record,
    stored,
    with_stored_records,
)
from tests.discovery import driven_twins
from tests.discovery.small_searches import FEWER

STEPS = ("load", "assess", "process")
Command = Callable[..., object]
Noting = Callable[[Campaign], "Noted"]


@dataclass(frozen=True)
class Noted(Campaign):
    """A campaign that notes in a file, from whatever process, what is done with its records."""

    log: Path = field(kw_only=True)

    def load(self, record: RecordSettings) -> Record:
        _note(self.log, "load", record.file)
        for step in ("assess", "process"):  # of this process, which may be a worker
            plain = getattr(measured_records, step)
            if not isinstance(plain, _Noting):
                setattr(measured_records, step, _Noting(self.log, step, plain))
        return super().load(record)


@dataclass(frozen=True)
class _Noting:
    log: Path
    step: str
    plain: Callable[..., object]

    def __call__(self, record: Record, *others: object) -> object:
        _note(self.log, self.step, record.file)
        return self.plain(record, *others)


def _note(log: Path, step: str, file: str) -> None:
    with log.open("a") as lines:  # a short line is appended whole
        lines.write(f"{step} {os.getpid()} {file}\n")


@pytest.fixture
def noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Campaign], Noted]:
    """Return the campaign with its notes; afterwards this process takes none any more."""
    for step in ("assess", "process"):
        monkeypatch.setattr(measured_records, step, getattr(measured_records, step))
    return lambda campaign: Noted(
        campaign.path, campaign.settings, campaign.digest, campaign.digests, log=tmp_path / "log"
    )


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five preloads, records of 2.5 s."""
    from experiments.studies import rig

    folder = tmp_path_factory.mktemp("rig") / "campaign"
    return rig.run(folder, cases=5, seed=3, jobs=1, duration_s=2.5, scatter=0.0)


def processes_of(command: Command, campaign: Noted, jobs: int) -> set[int]:
    """Run a command; each record it uses must be there once a step. Return the processes that read some."""
    with execution():
        command(campaign, jobs)
    lines = [line.split() for line in campaign.log.read_text().splitlines()]
    counts = Counter((step, file) for step, _, file in lines)
    files = {file for _, file in counts}
    assert counts == {(step, file): 1 for step in STEPS for file in files}
    assert {record.file for record in campaign.select(hold_out=False)} <= files
    return {int(process) for _, process, _ in lines}


@pytest.mark.variant  # of driven bodies, and of impacts identified and ranked, it is in every run
def test_a_closed_loop_reads_each_record_once(noted: Noting, rig: Path) -> None:
    processes = processes_of(discovery.close_loop, noted(rom.read_campaign(rig)), jobs=2)
    assert len(processes - {os.getpid()}) > 1


def test_a_closed_loop_of_driven_bodies_reads_each_record_once(noted: Noting, tmp_path: Path) -> None:
    processes_of(discovery.close_loop, noted(driven_twins.driven(tmp_path / "driven")), jobs=2)


def discover(campaign: Campaign, jobs: int) -> None:
    """Find laws among few: how many are searched changes nothing about records."""
    few = {"libraries": ["velocity"], "optimizers": ["STLSQ"], "max_terms": 1}
    discovery.discover(campaign, jobs, criteria=FEWER, **few)


@pytest.mark.parametrize("command", [rom.identify, discover])
def test_other_commands_read_each_record_once(noted: Noting, rig: Path, command: Command) -> None:
    processes_of(command, noted(rom.read_campaign(rig)), jobs=1)


def test_what_was_stored_is_removed_after_an_error_too(
    rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    @with_stored_records
    def interrupted(campaign: Campaign) -> None:
        measured_record(campaign, campaign.settings.record[0])
        assert len(list(tmp_path.glob("*/*"))) == 1
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted(rom.read_campaign(rig))
    assert list(tmp_path.iterdir()) == []


def test_without_a_place_to_store_it_a_record_is_read_again(noted: Noting, rig: Path) -> None:
    campaign = noted(rom.read_campaign(rig))
    record = campaign.settings.record[0]
    with stored(campaign) as work:
        first = measured_record(work, record).measurement
    again = measured_record(work, record).measurement
    assert campaign.log.read_text().count("load") == 2
    for body, motion in first.motion.items():
        assert (motion.samples == again.motion[body].samples).all()


EAGER = discovery.Criteria().changed(
    records={"hit_share": 0.0, "hit_noise": 0.0, "hit_alone": 0.0, "hit_likeness": -1.0},
    suspicions={"lone_share": 1e9, "lone_height": 0.0},
)
"""A second hit is seen where none is, and overflow codes in every channel."""


def test_a_stored_record_is_judged_by_the_criteria_of_its_campaign(rig: Path) -> None:
    with stored(rom.read_campaign(rig)) as work:
        record, eager = work.select("coupled")[0], judged_by(work, EAGER.of_records)
        kinds = [[d.kind for d in measured_record(one, record).doubts] for one in (work, eager, work)]
    assert kinds == [[], ["second-hit"], []]


@pytest.mark.parametrize("command", [discovery.close_loop, discovery.discover])
def test_criteria_given_to_a_command_judge_the_records(rig: Path, command: Command) -> None:
    with pytest.raises(NothingLeftError, match="training records set aside"):
        command(rom.read_campaign(rig), criteria=EAGER)


def test_a_record_that_changed_since_it_was_checked_is_refused(tmp_path: Path) -> None:
    campaign = driven_twins.driven(tmp_path / "driven")
    record = campaign.settings.record[0]
    path = campaign.path / record.file
    path.write_bytes(path.read_bytes() + b"\n")
    with stored(campaign) as work, pytest.raises(RecordError, match="when the campaign was checked"):
        measured_record(work, record)
