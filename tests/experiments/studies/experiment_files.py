"""A small experiment, and what is read from its results."""

from __future__ import annotations

from pathlib import Path

HEAD = 'format = "boltlaw-experiment/1"\nname = "slip"\n'
SMALL = HEAD + 'command = "close"\ncampaigns = ["one", "two"]\nseeds = [0, 1]\n'
WITHOUT_FIGURES = "figures = false\n"


def table_of(folder: Path) -> bytes:
    return (folder / "experiment.csv").read_bytes()


def cells_of(folder: Path) -> dict[str, int]:
    """Cells that are done, with the time when each was."""
    return {path.parent.name: path.stat().st_mtime_ns for path in folder.glob("cells/[!.]*/cell.json")}
