"""Records of a campaign read, assessed and processed once, however many steps and processes ask for them.

Work on a campaign goes over its records many times: identification, residual, tension and every evaluation of
a model. Within ``stored(campaign)`` the first to ask for a record reads it and leaves what came of it in a
scratch folder, where all others find it, worker processes too. One record is in memory at a time.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import wraps
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar, cast

from joblib import Parallel, delayed

from rom.campaign.campaign import Campaign, Record, RecordSettings
from rom.campaign.record import replacing
from rom.criteria.criteria import RecordCriteria
from rom.one_thread import one_threaded
from rom.signals.ground import relative_to_ground
from rom.signals.processing import Measurement, process
from rom.signals.quality import Doubt, assess
from rom.signals.suspicions import Evidence, Suspicion, causes, doubts_of, evidence, suspicions

F = TypeVar("F", bound=Callable[..., Any])
_RAW_TESTS = ("uncoupled", "driven", "free", "cycled")  # whose raw channels an identification needs as well


@dataclass(frozen=True, eq=False)
class MeasuredRecord:
    """A record as processed, with the default cutoff, the doubts about it, and its raw channels.

    Those are kept of uncoupled, driven, free and cycled records only: of others nobody needs them.
    """

    settings: RecordSettings
    doubts: tuple[Doubt, ...]
    measurement: Measurement
    raw: Record | None
    evidence: Evidence


@dataclass(frozen=True)
class Screening:
    """What the records of a campaign say against what it declares.

    `doubts` are those by file that come of it, in place of what a record tells by itself; `lost` the kinds of
    test all of whose training records are set aside.
    """

    suspicions: tuple[Suspicion, ...] = ()
    doubts: Mapping[str, tuple[Doubt, ...]] = field(default_factory=dict)
    lost: tuple[str, ...] = ()


class NothingLeftError(ValueError):
    """No training record is left to fit to; the message says why all were set aside."""

    def __init__(self, message: str, screening: Screening) -> None:
        super().__init__(message)
        self.screening = screening

    def __reduce__(self) -> tuple[type[NothingLeftError], tuple[str, Screening]]:
        return type(self), (str(self), self.screening)


@dataclass(frozen=True)
class StoredCampaign(Campaign):
    """A campaign whose records, once processed, are found in a scratch folder.

    `screening` is None before all records were looked at together.
    """

    source: Campaign = field(kw_only=True, repr=False)
    scratch: Path = field(kw_only=True, repr=False)
    screening: Screening | None = field(default=None, kw_only=True, repr=False, hash=False, compare=False)

    def load(self, record: RecordSettings) -> Record:
        """Read one record as the campaign does that this one was made of."""
        return self.source.load(record)


@contextmanager
def stored(campaign: Campaign) -> Iterator[Campaign]:
    """Give the campaign with a place for its processed records, which is removed at the end of the block.

    A campaign that has one already keeps it.
    """
    if isinstance(campaign, StoredCampaign) and campaign.scratch.is_dir():
        yield campaign
        return
    with TemporaryDirectory(prefix="boltlaw-", ignore_cleanup_errors=True) as scratch:
        yield StoredCampaign(
            campaign.path,
            campaign.settings,
            campaign.digest,
            campaign.digests,
            campaign.criteria,
            source=campaign,
            scratch=Path(scratch),
        )


def with_stored_records(function: F) -> F:
    """Return a function of a campaign, or several, and more, records being processed once in a call."""

    @wraps(function)
    def on_stored(campaign: Campaign | Sequence[Campaign], *args: Any, **kwargs: Any) -> Any:
        with ExitStack() as places:
            if isinstance(campaign, Sequence):
                several = [places.enter_context(stored(one)) for one in campaign]
                return function(several, *args, **kwargs)
            return function(places.enter_context(stored(campaign)), *args, **kwargs)

    return cast(F, on_stored)


def measured_record(campaign: Campaign, settings: RecordSettings) -> MeasuredRecord:
    """Return a record as processed, from the campaign's scratch folder where it is there.

    It is made anew where the campaign has no such folder, or this machine does not see it.

    Raises
    ------
    RecordError
        If the file is not what it was when the campaign was checked.
    ValueError
        Where a record lacks a channel that its kind of test needs.
    """
    if not isinstance(campaign, StoredCampaign) or settings not in campaign.settings.record:
        return _made(campaign, settings)
    found = _stored_record(campaign, settings)
    better = () if campaign.screening is None else campaign.screening.doubts.get(settings.file, ())
    return replace(found, doubts=better) if better else found


def _stored_record(campaign: StoredCampaign, settings: RecordSettings) -> MeasuredRecord:
    place = campaign.settings.record.index(settings)
    path = campaign.scratch / f"{place}-{hash(campaign.criteria)}.pickle"
    with suppress(FileNotFoundError), path.open("rb") as file:
        found: MeasuredRecord = pickle.load(file)
        return found
    made = _made(campaign, settings)
    with suppress(OSError), replacing(path) as part, part.open("wb") as file:  # no room: made again next time
        pickle.dump(made, file, protocol=pickle.HIGHEST_PROTOCOL)
    return made


def judged_by(campaign: Campaign, criteria: RecordCriteria) -> Campaign:
    """Return the campaign with other criteria by which records are set aside."""
    if criteria == campaign.criteria:
        return campaign
    if isinstance(campaign, StoredCampaign):
        return replace(campaign, criteria=criteria, screening=None)
    return replace(campaign, criteria=criteria)


@one_threaded
def screened(campaign: Campaign, jobs: int = 1) -> Campaign:
    """Return a stored campaign with the suspicions that all its records raise together, looked for once.

    A campaign without a place for its records is returned as it is.
    """
    if not isinstance(campaign, StoredCampaign) or campaign.screening is not None:
        return campaign
    tasks = (delayed(_evidence)(campaign, record) for record in campaign.settings.record)
    records = Parallel(n_jobs=jobs, pre_dispatch="2*n_jobs")(tasks)
    found = suspicions(records, campaign.settings, campaign.criteria.suspicions)
    doubts = doubts_of(found, records)
    aside = {record.file for record in records if record.doubts} | doubts.keys()
    training = campaign.select(hold_out=False)
    left = {record.test for record in training if record.file not in aside}
    lost = tuple(dict.fromkeys(record.test for record in training if record.test not in left))
    return replace(campaign, screening=Screening(found, doubts, lost))


def with_something_left(campaign: Campaign) -> Campaign:
    """Return a screened campaign that has a training record to fit to.

    Raises
    ------
    NothingLeftError
        If all training records are set aside; the message names the causes.
    """
    screening = campaign.screening if isinstance(campaign, StoredCampaign) else None
    training = campaign.select(hold_out=False)
    if screening is None or not training or {record.test for record in training} - set(screening.lost):
        return campaign
    count = f"all {len(training)} training records" if len(training) > 1 else "the one training record"
    why = "; ".join(causes(screening.suspicions))
    raise NothingLeftError(
        f"{campaign.path}: found {count} set aside, expected one that is not: {why}", screening
    )


def _evidence(campaign: StoredCampaign, settings: RecordSettings) -> Evidence:
    return _stored_record(campaign, settings).evidence


def _made(campaign: Campaign, settings: RecordSettings) -> MeasuredRecord:
    record = relative_to_ground(campaign.load(settings), campaign.settings)
    doubts = assess(record, campaign.settings, campaign.criteria.records)
    raw = record if record.test in _RAW_TESTS else None
    told = evidence(record, campaign.settings, doubts, campaign.criteria)
    return MeasuredRecord(settings, doubts, process(record, campaign.settings), raw, told)
