"""Pages that are notebooks too: ``python -m tests.documents.notebooks`` writes docs/notebooks from them.

A page and its notebook are one text: prose becomes cells of text, a block that is run becomes a cell of code.
With ``--run`` the notebooks are executed in a kernel and keep what they print; without, they keep what cells
that did not change printed before. The site shows this output below the blocks of the page.
"""

from __future__ import annotations

import json
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from markdown_it import MarkdownIt

from tests.documents.blocks import REPOSITORY, SHOWN, Block, commands, left_out

DOCS = REPOSITORY / "docs"
FOLDER = DOCS / "notebooks"
NOTEBOOKS = {
    "first-hour": "tutorial.md",
    "own-data": "own-data.md",
    "own-law": "own-law.md",
    "what-is-missing": "what-is-missing.md",
    "measured-data": "measured-data.md",
    "cluster": "cluster.md",
}
"""The page of every notebook."""
_KERNEL = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
_LINK = re.compile(r"\]\((?!\w+://|#)([^)]+)\)")
_MOST = 600_000  # bytes of a cell's output: a larger picture is not kept


def cell_of(block: Block) -> str | None:
    """Return the code of a block, as a notebook runs it; None for one that is only read."""
    if block.kind in SHOWN:
        return None
    if block.file is not None:
        return f"%%writefile {block.file}\n{block.text}"
    if block.kind == "python":
        return f"%matplotlib inline\n{block.text}" if ".plot(" in block.text else block.text
    lines = [] if block.kind != "sh" else commands(block)
    if not lines or any(left_out(words) for words in lines):
        return None
    return f"%%sh -e\n{block.text}"  # no terminal, so no progress bars


def cells(text: str) -> Iterator[tuple[str, str, int]]:
    """Yield kind, source and last line of every cell of a page, in order."""
    lines, start = text.splitlines(keepends=True), 0
    for token in MarkdownIt().parse(text):
        if token.type != "fence" or token.map is None or token.level:
            continue
        code = cell_of(Block(DOCS, token.map[0] + 2, token.info.strip(), token.content))
        if code is None:
            continue
        if prose := "".join(lines[start : token.map[0]]).strip():
            yield "markdown", prose, token.map[0]
        yield "code", code.rstrip(), token.map[1]
        start = token.map[1]
    if prose := "".join(lines[start:]).strip():
        yield "markdown", prose, len(lines)


def notebook(page: Path) -> dict[str, Any]:
    """Return the notebook of a page, nothing run. Links lead from its folder."""
    found = []
    for number, (kind, source, _) in enumerate(cells(page.read_text(encoding="utf-8"))):
        text = source if kind == "code" else _LINK.sub(r"](../\1)", source)
        cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}}
        ran = {"execution_count": None, "outputs": []} if kind == "code" else {}
        found.append(cell | ran | {"source": text.splitlines(keepends=True)})
    return {"cells": found, "metadata": _KERNEL, "nbformat": 4, "nbformat_minor": 5}


def sources(book: dict[str, Any]) -> list[tuple[str, str]]:
    """Return kind and source of all cells."""
    return [(cell["cell_type"], "".join(cell["source"])) for cell in book["cells"]]


def stored(name: str) -> dict[str, Any]:
    """Return a notebook as it lies in docs/notebooks; one without cells where it does not."""
    path = FOLDER / f"{name}.ipynb"
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"cells": []}
    return found


def outputs(book: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """Return what each cell of code printed, by its source."""
    return {"".join(cell["source"]): cell["outputs"] for cell in book["cells"] if cell.get("outputs")}


def executed(book: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a notebook with what it prints in a kernel that starts in a folder."""
    import nbformat
    from nbclient import NotebookClient

    node = nbformat.reads(json.dumps(book), as_version=4)
    surroundings = {
        **os.environ,
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
        "PYTHONPATH": str(REPOSITORY),
    }
    client = NotebookClient(
        node,
        timeout=3600,
        iopub_timeout=600,  # on a busy machine output comes late; it is never dropped in silence
        raise_on_iopub_timeout=True,
        resources={"metadata": {"path": str(folder)}},
    )
    client.execute(env=surroundings)
    ran: dict[str, Any] = json.loads(nbformat.writes(node))
    for cell in ran["cells"]:
        cell["metadata"] = {}
        if cell["cell_type"] == "code":
            cell["outputs"] = list(light(cell["outputs"], str(folder)))
    return ran | {"metadata": _KERNEL}


def prepare(page: Path, folder: Path) -> None:
    """Put into a folder what a page has from elsewhere: measured data, and what was found in them."""
    if page.name != NOTEBOOKS["measured-data"]:
        return
    from experiments.studies.import_campaign import run
    from tests.shared import measured

    run("emps", measured("emps"), folder / "emps")
    (folder / "emps-results").mkdir()
    found = json.loads((DOCS / "measured" / "emps.json").read_text(encoding="utf-8"))["closure"]
    (folder / "emps-results" / "closure.json").write_text(json.dumps(found), encoding="utf-8")


def light(found: list[dict[str, Any]], folder: str) -> Iterator[dict[str, Any]]:
    """Yield what was printed, in one piece, without the scratch folder; and figures that are not large."""
    streams = [one for one in found if one["output_type"] == "stream" and one["name"] == "stdout"]
    text = "".join("".join(one["text"]) for one in streams).replace(f"{folder}/", "")
    if text.strip():
        yield streams[0] | {"text": text.splitlines(keepends=True)}
    for one in found:
        if "data" in one:
            kinds = {k: v for k, v in one["data"].items() if k in ("text/plain", "image/png")}
            if len(json.dumps(kinds)) > _MOST:
                kinds.pop("image/png", None)
            yield one | {"data": kinds}


def with_outputs(page: Path, text: str) -> str:
    """Return a page's text with a link to its notebook, and below its blocks what the notebook printed."""
    name = next((name for name, of in NOTEBOOKS.items() if DOCS / of == page), None)
    if name is None:
        return text
    lines, known = text.splitlines(), outputs(stored(name))
    for kind, source, last in reversed(list(cells(text))):
        if kind == "code" and source in known:
            lines[last:last] = ["", *(line for one in known[source] for line in _shown(one))]
    title = next(number for number, line in enumerate(lines) if line.startswith("# "))
    lines[title + 1 : title + 1] = ["", f"This page as a notebook: [{name}.ipynb](notebooks/{name}.ipynb)."]
    return "\n".join(lines) + "\n"


def _shown(one: dict[str, Any]) -> list[str]:
    data = one.get("data", {"text/plain": one.get("text", [])})
    if "image/png" in data:
        picture = "".join(data["image/png"]).replace("\n", "")
        return ["", f"![Figure drawn by the code above](data:image/png;base64,{picture})", ""]
    return ["````text", *"".join(data["text/plain"]).rstrip().splitlines(), "````", ""]


def main(arguments: list[str]) -> None:
    """Write the notebooks named, or all."""
    run = "--run" in arguments
    for name in [one for one in arguments if one != "--run"] or NOTEBOOKS:
        book, before = notebook(DOCS / NOTEBOOKS[name]), outputs(stored(name))
        if run:
            with tempfile.TemporaryDirectory() as folder:
                prepare(DOCS / NOTEBOOKS[name], Path(folder))
                book = executed(book, Path(folder))
        else:
            for cell in book["cells"]:
                if cell["cell_type"] == "code":
                    cell["outputs"] = before.get("".join(cell["source"]), [])
        FOLDER.mkdir(exist_ok=True)
        text = json.dumps(book, indent=1, ensure_ascii=False) + "\n"
        (FOLDER / f"{name}.ipynb").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
