"""One self-contained page of whatever result files a folder holds."""

from __future__ import annotations

from pathlib import Path

from experiments.run.publication import finish
from rom.campaign.record import replacing


def run(directory: str | Path, out: str | Path | None = None) -> Path:
    """Write ``report.html`` from the result files and figures of a folder.

    Parameters
    ----------
    directory : str or Path
        Folder with model.json, reproduction.json, prediction.json, ranking.json, closure.json or
        experiment.json, and figures (*.svg).
    out : str or Path
        Folder to write to, or a file ending in .html; beside the results if not given.

    Returns
    -------
    Path
        The page; it appears whole or not at all.

    Raises
    ------
    ValueError
        If the folder holds no result file.
    """
    from experiments.report.document import render

    directory = Path(directory)
    finish(directory)
    text = render(directory)
    target = directory if out is None else Path(out)
    if target.suffix.lower() != ".html":
        target = target / "report.html"
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacing(target) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace")  # half a letter is none
    return target
