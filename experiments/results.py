"""Result files: a header that says how they were made, no NaN, whole or not at all."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rom.campaign.campaign import Campaign
from rom.campaign.record import replacing
from rom.provenance import program_version, versions

FIGURE_FORMAT = "boltlaw-figure/1"
"""Of the description that the SVG of a figure carries."""


def write_result(
    path: Path,
    kind: str,
    content: Mapping[str, Any],
    *,
    campaign: str | None,
    seed: int | None,
    elapsed_s: float,
) -> Path:
    """Write `content` as ``boltlaw-<kind>/1`` with the common header; returns the path.

    Parameters
    ----------
    path : Path
        The file; its folder is made.
    kind : str
        Which format it has.
    content : mapping
        All but the header.
    campaign : str or None
        Name of the campaign.
    seed : int or None
        Of all that was drawn.
    elapsed_s : float
        Time that it took [s].

    Returns
    -------
    Path
        The file.
    """
    header = {
        "format": f"boltlaw-{kind}/1",
        "campaign": campaign,
        "program_version": program_version(),
        "versions": versions(),
        "seed": seed,
        "elapsed_s": round(elapsed_s, 3),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        text = json.dumps(plain({**header, **content}), indent=1, allow_nan=False, ensure_ascii=False)
        temporary.write_text(text + "\n", encoding="utf-8")
    return path


def plain(value: Any) -> Any:
    """Return what JSON can hold: arrays as lists, NumPy numbers as numbers, NaN and infinity as None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def fitted_records(campaigns: Iterable[Campaign]) -> list[str]:
    """Return the digests of all training records: a campaign of others is one that no fit has seen."""
    return sorted(
        one.digests[record.file]
        for one in campaigns
        for record in one.settings.record
        if not record.hold_out and record.file in one.digests
    )


def results_folder(campaign: Path, out: Path | None) -> Path:
    """Return where results go: `out`, or ``<campaign>-results`` beside the campaign.

    Raises
    ------
    OSError
        If nothing can be written there.
    """
    if out is not None:
        return writable(out)
    folder = campaign.resolve()
    if folder.is_file():
        folder = folder.parent
    return writable(folder.with_name(folder.name + "-results"))


def writable(folder: Path) -> Path:
    """Return a folder for results, which need not exist yet: asked before long work, not after it.

    Raises
    ------
    OSError
        If it is a file, lies in one, or may not be written to.
    """
    absolute = folder.absolute()
    place = next(path for path in (absolute, *absolute.parents) if path.exists())
    if not place.is_dir():
        raise NotADirectoryError(f"{folder}: found the file {place}, expected a folder for results")
    if not os.access(place, os.W_OK | os.X_OK):
        raise PermissionError(f"{folder}: {place} may not be written to; name another folder with --out")
    return folder
