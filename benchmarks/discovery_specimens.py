"""Campaigns of the virtual rig whose bolt follows a law, reduced and frozen for fits of tension laws."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.discovery_truth import LAWS, Truth, read_truth, truth_of
from discovery.courses.frozen_motion import FrozenMotion, freeze
from experiments.rig.campaign import Laboratory, settings
from experiments.rig.plant import Plant
from experiments.rig.schedule import Case, plan
from experiments.rig.sensors import Instruments
from experiments.studies import rig
from rom.campaign.campaign import Campaign, Record, RecordSettings, read_campaign
from rom.campaign.checks import moving_bodies
from rom.identification.identify import Identification, identify_campaign
from rom.identification.reduce import reduce_records, reduce_sound, tension_courses
from rom.model.model import Model
from rom.signals.measured_records import MeasuredRecord
from rom.signals.processing import process
from rom.signals.suspicion_evidence import Evidence
from rom.signals.tension_bins import TensionCourse

PRELOADS = 20
HOLD_OUT_EVERY = 5
STRENGTHS = (1.0, 0.8, 0.6)


@dataclass(frozen=True)
class Setting:
    """What is varied: noise, scatter of gamma from test to test, length of a record [s], hits per preload."""

    noise: float = 1.0
    scatter: float = 1.0
    duration_s: float = 8.5
    strengths: tuple[float, ...] = STRENGTHS


def measure(folder: Path, law: str, seed: int, setting: Setting, jobs: int = 1) -> Campaign:
    """Make a campaign of the virtual rig whose bolt follows a law; one preload in five is held out."""
    rig.run(
        folder, PRELOADS, setting.noise, seed, jobs, duration_s=setting.duration_s, scatter=setting.scatter,
        strengths=setting.strengths, hold_out_every=HOLD_OUT_EVERY, plant=Plant(loosening=LAWS[law]),
    )  # fmt: skip
    return read_campaign(folder, jobs)


@dataclass(frozen=True)
class Bench(Campaign):
    """A campaign not written down: a test is run when it is loaded, sample for sample as by `measure`.

    For a plant that is known already: then the tests that would tell it need not be run.
    """

    laboratory: Laboratory = field(kw_only=True)
    tests: Mapping[str, tuple[Case, np.random.SeedSequence]] = field(kw_only=True)

    def load(self, record: RecordSettings) -> Record:
        case, seed = self.tests[record.file]
        fresh = np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key)
        channels, _ = self.laboratory.measure(case, fresh)
        rounded = {
            name: replace(channel, samples=channel.samples.astype(np.float32).astype(np.float64))
            for name, channel in channels.items()
        }
        return Record(record, rounded, moving_bodies(record, self.settings, rounded))

    def measured(self, record: RecordSettings) -> MeasuredRecord:
        """Run a loosening test and process it; there is no fault to look for."""
        sound = Evidence(record.file, record.test, record.preload_n, (), True, None, "", None, (), {})
        return MeasuredRecord(record, (), process(self.load(record), self.settings), None, sound)


def bench(law: str, seed: int, setting: Setting) -> Bench:
    """Set up the tests of `measure` without running any."""
    laboratory = Laboratory(
        Plant(loosening=LAWS[law]), Instruments().scaled(setting.noise), setting.duration_s
    )
    of_schedule, of_records = np.random.SeedSequence(seed).spawn(2)
    cases = plan(PRELOADS, setting.strengths, setting.scatter, False, HOLD_OUT_EVERY, of_schedule)
    declared = settings("bench", cases, laboratory.plant, laboratory.instruments)
    tests = {case.file: (case, own) for case, own in zip(cases, of_records.spawn(len(cases)), strict=True)}
    return Bench(Path(), declared, "", laboratory=laboratory, tests=tests)


def loosening_courses(
    campaign: Campaign, found: Identification, hold_out: bool | None = None
) -> tuple[TensionCourse, ...]:
    """Reduce the loosening records that are held out, the others, or all (None) to tension courses."""
    chosen = campaign.select("loosening", hold_out)
    if isinstance(campaign, Bench):
        records = [reduce_sound(campaign.measured(record), campaign) for record in chosen]
    else:
        records = [record for record in reduce_records(campaign, chosen) if not record.doubts]
    return tension_courses(records, found.course_noise, campaign.settings)


def frozen_courses(model: Model, courses: Sequence[TensionCourse]) -> tuple[FrozenMotion, FrozenMotion]:
    """Motion and courses of the training records and of those held out."""
    bare = replace(model, identification=None)
    training, unseen = ([c for c in courses if c.hold_out is held] for held in (False, True))
    return freeze(bare, training), freeze(bare, unseen)


@dataclass(frozen=True, eq=False)
class Specimen:
    """Motion and courses of a campaign's loosening records, the truth, and the identification behind them."""

    training: FrozenMotion
    hold_out: FrozenMotion
    truth: Truth
    identified: Identification


def specimen(law: str, seed: int, setting: Setting, known: Identification | None = None) -> Specimen:
    """Make a campaign, identify it unless its plant is known already, and freeze its loosening records.

    ``known`` may come from another campaign of the same seed, whose tests without the bolt and of soft hits
    are the same ones but for what a soft hit loosens: here only the loosening tests are run.
    """
    if known is not None:
        courses = loosening_courses(bench(law, seed, setting), known)
        return Specimen(*frozen_courses(known.model, courses), truth_of(LAWS[law]), known)
    with tempfile.TemporaryDirectory() as scratch:
        return specimen_of(measure(Path(scratch) / "campaign", law, seed, setting))


def specimen_of(campaign: Campaign, known: Identification | None = None) -> Specimen:
    """Read a campaign as `specimen` does, and the truth beside it."""
    if known is None:
        found = identify_campaign(campaign)
        courses = (*found.courses, *loosening_courses(campaign, found, hold_out=True))
        known = replace(found, courses=())
    else:
        courses = loosening_courses(campaign, known)
    return Specimen(*frozen_courses(known.model, courses), read_truth(rig.truth_path(campaign.path)), known)
