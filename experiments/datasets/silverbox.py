"""Silverbox: an electronic circuit that imitates a mass on a hardening spring.

Wigren, Schoukens, "Three free data sets for development and benchmarking in nonlinear system identification",
European Control Conference, 2013. `V1` [V] drives the circuit, `V2` [V] is its answer. The volts are taken as
N and m: the mass that is found is in V s2/V, and only ratios to it mean anything.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from experiments.datasets.collected import Collected, SourceError, file_of
from experiments.datasets.vectors import mat_vectors, same_length
from rom.campaign.campaign import FORMAT, CampaignSettings
from rom.campaign.channels import Channel, FloatArray

RATE_HZ = 1e7 / 2**14
FILE = "SNLS80mV.mat"
ARROW = 40_000  # samples of noise whose strength grows beyond that of the multisines
MULTISINES = 10
QUIET = 64  # samples between two multisines at least; within one the drive is never still for so long
STILL = 0.25  # of the drive's RMS after the arrow: what is left between multisines is below it
NAME = (
    "Silverbox (Wigren, Schoukens 2013); volts taken as N and m, so only ratios to the mass are identifiable"
)


def collect(source: Path) -> Collected:
    """Return the campaign of `SNLS80mV.mat`.

    Raises
    ------
    SourceError
        If the file is missing or not what it should be.
    """
    path = file_of(source, FILE)
    vectors = mat_vectors(path, ("V1", "V2"))
    same_length(path, vectors)
    parts = {"records/arrow.h5": slice(0, ARROW)}
    for number, part in enumerate(multisines(path.name, vectors["V1"]), start=1):
        parts[f"records/multisine_{number:02d}.h5"] = part
    held_out = {"records/arrow.h5", f"records/multisine_{MULTISINES:02d}.h5"}
    settings = CampaignSettings.model_validate(
        {
            "format": FORMAT,
            "name": NAME,
            "body": [{"name": "oscillator"}],
            "link": [{"name": "spring", "between": ["oscillator", "ground"], "law": "linear"}],
            "sampling": {"motion_rate_hz": RATE_HZ, "tension_rate_hz": RATE_HZ, "pretrigger_s": 0.0},
            "record": [
                {"file": file, "test": "driven", "bodies": ["oscillator"], "hold_out": file in held_out}
                for file in parts
            ],
        }
    )

    def records() -> Iterator[tuple[str, dict[str, Channel]]]:
        for file, part in parts.items():
            force = Channel("force_oscillator", vectors["V1"][part], RATE_HZ)
            motion = Channel("displacement_oscillator", vectors["V2"][part], RATE_HZ)
            yield file, {channel.name: channel for channel in (force, motion)}

    return Collected(settings, records())


def multisines(name: str, drive: FloatArray) -> list[slice]:
    """Return where the multisines are: from the first sample of one to the last before the next.

    The drive is still for a while before each and after the last. Free decay after a multisine belongs to it,
    so that the next one starts as near to rest as it can.

    Raises
    ------
    SourceError
        If there are not ten of one length.
    """
    after = drive[ARROW:]
    with np.errstate(over="ignore"):  # a sample of any size: then all others are still
        still = np.abs(after - np.median(after)) < STILL * float(np.std(after)) if len(after) else after > 0
    rests = [(start, stop) for start, stop in runs(still) if stop - start >= QUIET]
    found = [
        (rest[1], following) for rest, following in pairwise(rests) if following[0] - rest[1] > 10 * QUIET
    ]
    lengths = [following[1] - start for start, following in found[:-1]]
    if len(found) != MULTISINES or max(lengths) > 1.01 * min(lengths):
        raise SourceError(
            f"{name}: V1: found {len(found)} multisines of {lengths or 'no'} samples after sample {ARROW}, "
            f"expected {MULTISINES} of one length with a still drive between them"
        )
    usual = int(np.median(lengths))
    stops = [min(following[1], start + usual) for start, following in found]
    return [slice(ARROW + start, ARROW + stop) for (start, _), stop in zip(found, stops, strict=True)]


def runs(mask: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return start and stop of every run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return [(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]
