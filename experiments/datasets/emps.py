"""EMPS: a carriage on a guide, driven by a motor through a ball screw.

Janot, Gautier, Brunot, "Data set and reference models of EMPS", Workshop on Nonlinear System Identification
Benchmarks, Eindhoven, 2019. The controller's voltage `vir` [V] times the gain `gtau` [N/V] is the force on
the carriage; `qm` [m] is its position. The second file adds pulses of force that no fit should have seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from experiments.datasets.collected import Collected, SourceError, file_of
from experiments.datasets.vectors import mat_vectors, rate_of, same_length
from rom.campaign.campaign import FORMAT, CampaignSettings
from rom.campaign.channels import Channel

RATE_HZ = 1000.0
FILES = {"records/emps.h5": "DATA_EMPS.mat", "records/emps_pulses.h5": "DATA_EMPS_PULSES.mat"}


def collect(source: Path) -> Collected:
    """Return the campaign of a folder that holds both files.

    Raises
    ------
    SourceError
        If one is missing or not what it should be.
    """
    folder = source.parent if source.is_file() else source
    paths = {record: file_of(folder, name) for record, name in FILES.items()}
    training, hold_out = FILES
    entry = {"test": "driven", "bodies": ["carriage"]}
    settings = CampaignSettings.model_validate(
        {
            "format": FORMAT,
            "name": "EMPS: carriage on a guide (Janot, Gautier, Brunot 2019)",
            "body": [{"name": "carriage"}],
            "link": [{"name": "guide", "between": ["carriage", "ground"], "law": "dashpot"}],
            "sampling": {"motion_rate_hz": RATE_HZ, "tension_rate_hz": RATE_HZ, "pretrigger_s": 0.0},
            "record": [
                {**entry, "file": training, "hold_out": False},
                {**entry, "file": hold_out, "hold_out": True},
            ],
        }
    )
    return Collected(settings, _records(paths))


def _records(paths: Mapping[str, Path]) -> Iterator[tuple[str, dict[str, Channel]]]:
    for record, path in paths.items():
        vectors = mat_vectors(path, ("t", "qm", "vir"))
        same_length(path, vectors)
        rate_hz = rate_of(f"{path.name}: t", vectors["t"])
        if abs(rate_hz / RATE_HZ - 1) > 1e-4:
            raise SourceError(f"{path.name}: t: found {rate_hz:.6g} Hz, expected {RATE_HZ:g} Hz")
        gain = mat_vectors(path, ("gtau",))["gtau"]
        if gain.size != 1 or gain[0] == 0.0:
            raise SourceError(f"{path.name}: gtau: found {gain[:3]}, expected the drive's gain [N/V]")
        force = Channel("force_carriage", gain[0] * vectors["vir"], RATE_HZ)
        position = Channel("displacement_carriage", vectors["qm"], RATE_HZ)
        yield record, {channel.name: channel for channel in (force, position)}
