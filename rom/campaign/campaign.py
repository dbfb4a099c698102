"""Campaigns: a folder of `campaign.toml` and one file per record, checked once and read record by record."""

from __future__ import annotations

import hashlib
import os
import secrets
import shutil
import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

from pydantic import ValidationError

from rom.campaign.channels import (
    BOLT_CHANNELS,
    MOTIONS,
    Channel,
    Motion,
    motion_channels,
    one_of,
)
from rom.campaign.checks import Check, check_record, file_digest, moving_bodies
from rom.campaign.record import Precision, RecordError, read_channels, write_channels
from rom.campaign.sensors import places_of, sensor_faults
from rom.campaign.settings import (
    FORMAT,
    BodySettings,
    BoltSettings,
    CampaignSettings,
    LinkSettings,
    RecordSettings,
    SamplingSettings,
    Test,
    WindowSettings,
)
from rom.campaign.settings_faults import parsing_faults, record_faults, structure_faults
from rom.criteria.criteria import RECORD_CRITERIA, RecordCriteria
from rom.jobs import processes_for
from rom.progress import counted
from rom.result_views import HasViews

__all__ = [
    "FORMAT",
    "BodySettings",
    "BoltSettings",
    "Campaign",
    "CampaignError",
    "CampaignSettings",
    "LinkSettings",
    "Record",
    "RecordSettings",
    "SamplingSettings",
    "WindowSettings",
    "read_campaign",
    "write_campaign",
]


_LONGEST_LINE = 500
CHANGED = "file: found other content than when the campaign was checked, expected it to stay: run again"


class CampaignError(ValueError):
    """A campaign that is refused; `faults` holds one line for each fault: file, key, found, expected."""

    def __init__(self, faults: Iterable[str]) -> None:
        self.faults = tuple(terminal_line(fault) for fault in faults)
        super().__init__("\n".join(self.faults))

    def __reduce__(self) -> tuple[type[CampaignError], tuple[tuple[str, ...]]]:
        return type(self), (self.faults,)


def terminal_line(text: str) -> str:
    """Return a text as one line for a terminal, whatever a file's names and values hold."""
    text = " ".join(text.split())
    if len(text) > _LONGEST_LINE:
        text = f"{text[: _LONGEST_LINE // 2]} ... {text[-_LONGEST_LINE // 2 :]}"
    return "".join(char if char.isprintable() else ascii(char)[1:-1] for char in text)


@dataclass(frozen=True, eq=False)
class Record:
    """One test: its settings, its channels by name, and the bodies that move in it.

    `relative` tells channels that are seen from a ground that moves (`rom.signals.ground`).
    """

    settings: RecordSettings
    channels: Mapping[str, Channel]
    bodies: tuple[str, ...]
    relative: bool = False

    @property
    def file(self) -> str:
        """Path inside the campaign folder."""
        return self.settings.file

    @property
    def test(self) -> Test:
        """Kind of test."""
        return self.settings.test

    @property
    def hold_out(self) -> bool:
        """True where the record must not be used to fit anything."""
        return self.settings.hold_out

    @property
    def preload_n(self) -> float | None:
        """Nominal preload [N], None where not stated."""
        return self.settings.preload_n

    @property
    def duration_s(self) -> float:
        """Length of the record [s]: that of its longest channel."""
        return max(channel.duration_s for channel in self.channels.values())

    def motion(self, body: str) -> tuple[Motion, Channel]:
        """Return what was measured of a body ("acceleration", "velocity" or "displacement") and its channel.

        Raises
        ------
        ValueError
            If the record holds no motion of that body.
        """
        for motion, name in zip(MOTIONS, motion_channels(body), strict=True):
            if name in self.channels:
                return motion, self.channels[name]
        raise ValueError(f'{self.file}: found no motion of "{body}", expected one of {motion_channels(body)}')

    def force(self, body: str) -> Channel | None:
        """Return the force on a body, None where none was measured."""
        return self.channels.get(f"force_{body}")

    @property
    def driven(self) -> tuple[str, ...]:
        """Where a force was measured, in alphabetical order."""
        return places_of(("force",), self.channels)

    def tension_channel(self) -> Channel:
        """Return the channel "tension", or else "strain".

        Raises
        ------
        ValueError
            If the record holds neither.
        """
        for name in BOLT_CHANNELS:
            if name in self.channels:
                return self.channels[name]
        raise ValueError(f'{self.file}: found no bolt channel, expected "tension" or "strain"')


@dataclass(frozen=True)
class Campaign(HasViews):
    """A checked campaign folder: `path`, its settings, and `digest` (SHA-256 of settings and records).

    `digests` holds that of each record by file: what is read later must be what was checked. A record without
    one is not compared. `criteria` are those by which its records are set aside.
    """

    path: Path
    settings: CampaignSettings
    digest: str
    digests: Mapping[str, str] = field(default_factory=dict, repr=False, hash=False)
    criteria: RecordCriteria = field(default=RECORD_CRITERIA, repr=False)

    def select(
        self, test: str | Collection[str] | None = None, hold_out: bool | None = None
    ) -> tuple[RecordSettings, ...]:
        """Return the records of the given kinds of test (None: all), training, hold-out or both (None).

        Raises
        ------
        ValueError
            If a kind of test is unknown.
        """
        kinds = get_args(Test) if test is None else (test,) if isinstance(test, str) else tuple(test)
        for kind in kinds:
            if kind not in get_args(Test):
                raise ValueError(f'test: found "{kind}", expected {one_of(kind, get_args(Test))}')
        return tuple(
            record
            for record in self.settings.record
            if record.test in kinds and hold_out in (None, record.hold_out)
        )

    def load(self, record: RecordSettings) -> Record:
        """Read one record.

        Raises
        ------
        RecordError
            If the file is not, byte by byte, what it was when the campaign was checked.
        """
        sampling = self.settings.sampling
        path = self.path / record.file
        channels = read_channels(path, sampling.motion_rate_hz, sampling.tension_rate_hz)
        checked = self.digests.get(record.file)
        if checked is not None and file_digest(path) != checked:  # after reading: also what changed meanwhile
            raise RecordError(path, (CHANGED,))
        return Record(record, channels, moving_bodies(record, self.settings, channels))


def read_campaign(
    path: Path | str, jobs: int | None = None, progress: Callable[[int, int], None] | None = None
) -> Campaign:
    """Check a whole campaign, record by record, one in memory per job.

    Parameters
    ----------
    path
        The campaign folder, or its `campaign.toml`.
    jobs
        Processes that check records; if not given all cores, one for less than 50 MB of records.
    progress
        Called with the number of records checked and their total.

    Raises
    ------
    CampaignError
        If anything in the folder is not as it must be: one line for each fault.

    Examples
    --------
    >>> import rom
    >>> campaign = rom.read_campaign("campaign")
    >>> print(campaign.summary().splitlines()[0])
    two oscillators: 7 records of lo, so
    >>> campaign.to_frame().loc["records/driven.csv", "hold_out"].item()
    True
    """
    toml, text, settings = _settings_of(path)
    folder = toml.parent.absolute()  # worker processes may have been started in another folder
    faults = [f"{toml.name}: {line}" for line in record_faults(settings)]
    jobs = processes_for(jobs, [folder / record.file for record in settings.record])
    checks = list(counted(_checks(folder, settings, jobs), len(settings.record), progress))
    uncalibrated = [check.file for check in checks if check.needs_calibration]
    if uncalibrated:
        found = f"found nothing, but {uncalibrated[0]} and {len(uncalibrated) - 1} more records hold strain"
        faults.append(f'{toml.name}: bolt.calibration: {found}, expected coefficients or a channel "tension"')
    faults += [f"{check.file}: {line}" for check in checks for line in check.faults]
    faults += () if faults else sensor_faults(settings, {check.file: check.channels for check in checks})
    if faults:
        raise CampaignError(faults)
    digest = hashlib.sha256(text)
    for check in checks:
        digest.update(f"{check.file}\0{check.digest}".encode())
    return Campaign(folder, settings, digest.hexdigest(), {check.file: check.digest for check in checks})


def read_settings(path: Path | str) -> CampaignSettings:
    """Read and check the settings of a campaign alone, none of its records.

    Raises
    ------
    CampaignError
        One line for each fault of the structure.
    """
    return _settings_of(path)[2]


def _settings_of(path: Path | str) -> tuple[Path, bytes, CampaignSettings]:
    toml = Path(path) / "campaign.toml" if Path(path).is_dir() else Path(path)
    text = _bytes_of(toml)
    settings = _parsed(text, toml.name)
    if faults := [f"{toml.name}: {line}" for line in structure_faults(settings)]:
        raise CampaignError(faults)
    return toml, text, settings


def _bytes_of(toml: Path) -> bytes:
    try:
        if toml.exists() and not toml.is_file():  # a pipe or a device may never end
            raise CampaignError([f"{toml}: found a folder or device, expected a text file"])
        return toml.read_bytes()
    except FileNotFoundError:
        raise CampaignError([f"{toml}: found no such file, expected the settings of a campaign"]) from None
    except OSError as cause:
        raise CampaignError(
            [f"{toml}: found it unreadable ({cause.strerror}), expected a text file"]
        ) from None


def _parsed(text: bytes, name: str) -> CampaignSettings:
    try:
        settings = CampaignSettings.model_validate(tomllib.loads(text.decode("utf-8-sig")))
        return settings.with_values_of_all_records()
    except ValidationError as error:
        raise CampaignError(f"{name}: {line}" for line in parsing_faults(error)) from None
    except (ValueError, RecursionError) as cause:  # of TOML, of UTF-8, or of a number of too many digits
        raise CampaignError([f"{name}: found {cause}, expected TOML in UTF-8"]) from None


def _checks(folder: Path, settings: CampaignSettings, jobs: int) -> Iterator[Check]:
    indices = range(len(settings.record))
    if jobs == 1:
        yield from (check_record(folder, settings, index) for index in indices)
        return
    import joblib  # slow to load, and not needed to simulate

    tasks = (joblib.delayed(check_record)(folder, settings, index) for index in indices)
    yield from joblib.Parallel(n_jobs=jobs, return_as="generator")(tasks)


def write_campaign(
    folder: Path | str,
    settings: CampaignSettings,
    records: Iterable[tuple[str, Mapping[str, Channel]]],
    precision: Precision = "float64",
) -> None:
    """Write a campaign folder, one record in memory at a time; it appears whole or not at all.

    Parameters
    ----------
    folder
        A folder that does not exist yet.
    settings
        What `campaign.toml` will hold.
    records
        Pairs of file (as in `settings.record`) and channels, one for each record, in any order.
    precision
        Precision of the samples in `.h5` and `.mat` files.

    Raises
    ------
    CampaignError
        If the folder exists, the settings contradict each other, or the records are not the settings' own.
    """
    folder = Path(folder)
    if folder.exists() or folder.is_symlink():
        raise CampaignError([f"{folder}: found an existing path, expected a new folder"])
    if faults := (*structure_faults(settings), *record_faults(settings)):
        raise CampaignError(f"campaign.toml: {line}" for line in faults)
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}-{secrets.token_hex(4)}")
    try:
        temporary.mkdir()
        _write_records(temporary, settings, records, precision)
        (temporary / "campaign.toml").write_text(_toml(settings), encoding="utf-8")
        temporary.rename(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _write_records(
    folder: Path,
    settings: CampaignSettings,
    records: Iterable[tuple[str, Mapping[str, Channel]]],
    precision: Precision,
) -> None:
    expected = [record.file for record in settings.record]
    for file, channels in records:
        if file not in expected:
            raise CampaignError(
                [f"{file}: found a record that is not (or no longer) expected by the settings"]
            )
        expected.remove(file)
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        write_channels(folder / file, channels, precision)
    if expected:
        raise CampaignError(f"{file}: found no record, expected one as in the settings" for file in expected)


def _toml(settings: CampaignSettings) -> str:
    import tomli_w

    filled_in = {"body", "link"} if settings.modes is not None else None
    data: dict[str, Any] = settings.model_dump(exclude_none=True, exclude=filled_in)
    return tomli_w.dumps(data)
