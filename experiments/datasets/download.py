"""Fetching public benchmark sets through their official loader, the package nonlinear-benchmarks."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from experiments.datasets.collected import SourceError, optional
from rom.campaign.record import in_a_line

LOADERS = {"emps": "EMPS", "silverbox": "Silverbox"}
SITE = "nonlinearbenchmark.org"


def fetch(name: str, folder: Path) -> Path:
    """Download a set's own files to a folder and return where they are.

    The files as they were published, not the loader's arrays: these leave out the drive's gain of EMPS and
    the gaps of Silverbox.

    Raises
    ------
    SourceError
        If the set is not among those of the loader, or the loader is not installed or gets nothing.
    """
    if name not in LOADERS:
        raise SourceError(
            f"--download: found {name}, expected one of {', '.join(LOADERS)}; give SOURCE for all others"
        )
    loader = getattr(optional("nonlinear_benchmarks", "datasets"), LOADERS[name])
    told = io.StringIO()  # the loader prints as it goes
    try:
        with redirect_stdout(told), redirect_stderr(told):
            loader(data_file_locations=True, dir_placement=str(folder))
    except Exception as cause:  # network, archive, disk: each means that there are no files
        raise SourceError(
            f"--download: {name} could not be fetched ({in_a_line(cause)}); "
            f"connect to the network, or get the files from {SITE} and give their folder as SOURCE"
        ) from None
    return folder
