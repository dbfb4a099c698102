"""Notebooks are their pages, and a kernel runs what a page shows."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.documents.notebooks import (
    DOCS,
    FOLDER,
    NOTEBOOKS,
    cells,
    executed,
    notebook,
    outputs,
    prepare,
    sources,
    stored,
    with_outputs,
)

PAGE = """# A page
Text with a [link](theory.md).

```toml
# laws.toml
format = "boltlaw-laws/1"
```
```sh
boltlaw --version   # of the program
make test
```
```sh
boltlaw --version   # of the program
```
More text.
```python
from pathlib import Path

print(len(Path("laws.toml").read_text()))
```
"""


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_is_its_page(name: str) -> None:
    """`python -m tests.documents.notebooks` writes it anew."""
    assert sources(stored(name)) == sources(notebook(DOCS / NOTEBOOKS[name]))


def test_no_other_notebook_lies_there() -> None:
    assert {path.stem for path in FOLDER.iterdir()} == set(NOTEBOOKS)


def test_a_kernel_runs_what_a_page_shows(tmp_path: Path) -> None:
    """Its files, commands and Python; what is not run stays text."""
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    assert [kind for kind, *_ in cells(PAGE)] == ["markdown", "code", "markdown", "code", "markdown", "code"]
    book = notebook(page)
    assert "[link](../theory.md)" in sources(book)[0][1]
    ran = executed(book, tmp_path)
    assert sources(ran) == sources(book)
    shown = ["".join("".join(one.get("text", "")) for one in found) for found in outputs(ran).values()]
    assert [text.split()[0] for text in shown] == ["Writing", "boltlaw", "38"]


def test_the_site_shows_what_a_cell_printed_below_its_block(monkeypatch: pytest.MonkeyPatch) -> None:
    book = notebook(DOCS / "cluster.md")
    last = [cell for cell in book["cells"] if cell["cell_type"] == "code"][-1]
    last["outputs"] = [{"output_type": "stream", "name": "stdout", "text": ["976300.0\n"]}]
    monkeypatch.setattr("tests.documents.notebooks.stored", lambda _name: book)
    text = (DOCS / "cluster.md").read_text(encoding="utf-8")
    shown = with_outputs(DOCS / "cluster.md", text)
    block = "".join(last["source"])
    assert f"{block}\n```\n\n````text\n976300.0\n````\n" in shown
    assert "(notebooks/cluster.ipynb)" in shown.splitlines()[2]
    assert with_outputs(DOCS / "theory.md", text) == text


@pytest.mark.slow
@pytest.mark.variant
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_every_notebook_runs_in_a_kernel(name: str, tmp_path: Path) -> None:
    """Its cells are the blocks of its page, which `test_pages.py` runs without one."""
    prepare(DOCS / NOTEBOOKS[name], tmp_path)
    executed(stored(name), tmp_path)
