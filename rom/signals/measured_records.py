"""Records of a campaign read, assessed and processed once, however many steps and processes ask for them.

Work on a campaign goes over its records many times: identification, residual, tension and every evaluation of
a model. Within ``stored(campaign)`` the first to ask for a record reads it and leaves what came of it in a
scratch folder, where all others find it, worker processes too. One record is in memory at a time.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar, cast

from rom.campaign.campaign import Campaign, Record, RecordSettings
from rom.campaign.record import replacing
from rom.signals.processing import Measurement, process
from rom.signals.quality import Doubt, assess

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


@dataclass(frozen=True)
class StoredCampaign(Campaign):
    """A campaign whose records, once processed, are found in a scratch folder."""

    source: Campaign = field(kw_only=True, repr=False)
    scratch: Path = field(kw_only=True, repr=False)

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
            source=campaign,
            scratch=Path(scratch),
        )


def with_stored_records(function: F) -> F:
    """Return a function of a campaign and more, the campaign's records being processed once in a call."""

    @wraps(function)
    def on_stored(campaign: Campaign, *args: Any, **kwargs: Any) -> Any:
        with stored(campaign) as with_place:
            return function(with_place, *args, **kwargs)

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
    path = campaign.scratch / f"{campaign.settings.record.index(settings)}.pickle"
    with suppress(FileNotFoundError), path.open("rb") as file:
        found: MeasuredRecord = pickle.load(file)
        return found
    made = _made(campaign, settings)
    with suppress(OSError), replacing(path) as part, part.open("wb") as file:  # no room: made again next time
        pickle.dump(made, file, protocol=pickle.HIGHEST_PROTOCOL)
    return made


def _made(campaign: Campaign, settings: RecordSettings) -> MeasuredRecord:
    record = campaign.load(settings)
    doubts = assess(record, campaign.settings)
    raw = record if record.test in _RAW_TESTS else None
    return MeasuredRecord(settings, doubts, process(record, campaign.settings), raw)
