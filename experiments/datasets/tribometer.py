"""A reciprocating contact on a tribometer: a slider of 0.24 mm stroke under a normal force of 5 N.

From the examples of FrictionModels.jl (J. Christopherson, MIT licence), which calls it experimental and does
not describe the rig. A table with the columns time [s], normal force [uN], position [mm], friction [uN].
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from experiments.datasets.collected import Collected, SourceError, file_of, unreadable
from rom.campaign.campaign import FORMAT, CampaignSettings
from rom.campaign.channels import Channel, FloatArray

RATE_HZ = 200.0
FILE = "test_data_2.txt"
TRAINING = 0.6  # of the samples, the first; the last are held out
RECORDS = ("records/cycles_training.h5", "records/cycles_hold_out.h5")
COLUMNS = ("Time [s]", "Normal [uN]", "Position [mm]", "Friction [uN]")
LEAST = 0.9  # of the rows that must be evenly sampled in one piece


def collect(source: Path) -> Collected:
    """Return the campaign of `test_data_2.txt`.

    Raises
    ------
    SourceError
        If the file is missing or not what it should be.
    """
    path = file_of(source, FILE)
    rows, notes = evenly_sampled(path.name, read_table(path))
    cut = int(TRAINING * len(rows))
    parts = {RECORDS[0]: rows[:cut], RECORDS[1]: rows[cut:]}
    middle = 0.5 * (rows[:cut, 2].min() + rows[:cut, 2].max())
    settings = CampaignSettings.model_validate(
        {
            "format": FORMAT,
            "name": "tribometer: reciprocating contact (FrictionModels.jl)",
            "body": [{"name": "slider"}],
            "link": [{"name": "contact", "between": ["slider", "ground"], "law": "linear"}],
            "sampling": {"motion_rate_hz": RATE_HZ, "tension_rate_hz": RATE_HZ, "pretrigger_s": 0.0},
            "record": [{"file": file, "test": "cycled", "hold_out": file == RECORDS[1]} for file in parts],
        }
    )

    def records() -> Iterator[tuple[str, dict[str, Channel]]]:
        for file, part in parts.items():
            yield file, _channels(part, middle)

    return Collected(settings, records(), lambda: notes)


def _channels(rows: FloatArray, middle_mm: float) -> dict[str, Channel]:
    """Return the channels in SI.

    The stage's own zero lies 110 mm away and tells nothing of the contact: displacement counts from the
    middle of the training record's stroke. The file's friction falls as the position rises; the force of a
    link, k x + c v, is what it takes to move it, so its sign is the other one.
    """
    values = {
        "link_displacement_contact": 1e-3 * (rows[:, 2] - middle_mm),
        "link_force_contact": -1e-6 * rows[:, 3],
        "normal_force_contact": 1e-6 * rows[:, 1],
    }
    return {name: Channel(name, samples, RATE_HZ) for name, samples in values.items()}


def read_table(path: Path) -> FloatArray:
    """Return the four columns.

    Raises
    ------
    SourceError
        If the header is another one or the rows are not four finite numbers each.
    """
    import pandas as pd

    try:
        table = pd.read_csv(path, sep="\t")
    except Exception as cause:  # a parser of foreign bytes may fail in any way
        raise unreadable(path, "table of four columns with tabs between", cause) from None
    header = tuple(str(name).strip() for name in table.columns)
    if header != COLUMNS:
        raise SourceError(
            f"{path.name}: found the columns {', '.join(header)}, expected {', '.join(COLUMNS)}"
        )
    rows = table.apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if len(bad) or len(rows) < 2:
        where = f"row {bad[0] + 1} without four finite numbers" if len(bad) else f"{len(rows)} rows"
        raise SourceError(f"{path.name}: found {where}, expected a number in every cell")
    return np.asarray(rows)


def evenly_sampled(name: str, rows: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the longest piece at 200 Hz, and what was left out.

    Raises
    ------
    SourceError
        If that is less than nine tenths of the table.
    """
    steps = np.diff(rows[:, 0])
    breaks = np.flatnonzero(np.abs(steps * RATE_HZ - 1.0) > 0.25)
    edges = np.concatenate(([0], breaks + 1, [len(rows)]))
    longest = int(np.argmax(np.diff(edges)))
    piece = rows[edges[longest] : edges[longest + 1]]
    if len(piece) < LEAST * len(rows):
        raise SourceError(
            f"{name}: Time [s]: found {len(piece)} of {len(rows)} rows evenly spaced by {1 / RATE_HZ:g} s, "
            f"expected {100 * LEAST:.0f} % at least"
        )
    left_out = len(rows) - len(piece)
    if not left_out:
        return piece, ()
    return piece, (f"{name}: {left_out} rows before or after an uneven step of time are left out",)
