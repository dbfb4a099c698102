"""The code blocks of a Markdown page, and how each is carried out in a folder, as a reader would."""

from __future__ import annotations

import shlex
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from markdown_it import MarkdownIt

from experiments.datasets import PUBLIC

REPOSITORY = Path(__file__).parents[2]
PAGES = (REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").glob("*.md")))
SHOWN = frozenset({"text", "{toctree}"})
"""Kinds of block that are there to be looked at, or for the site; any other is carried out."""
_MEASURED = "needs data that others measured; tests of its own have them"
LEFT_OUT: Mapping[tuple[str, ...], str] = {
    ("make",): "makes an environment and runs everything",
    ("pip",): "changes the environment",
    ("pytest",): "is what runs this",
    ("python", "-m", "benchmarks"): "takes minutes to hours",
    ("python", "-m", "experiments.studies.blind"): "takes hours",
    ("dask",): "is a server, and no program of ours",
    ("boltlaw", "import"): _MEASURED,
    **{("boltlaw", "close", name): _MEASURED for name in PUBLIC},
    ("python", "-m", "experiments.studies.measured"): _MEASURED,
}
"""Shell commands that are not run, by their first words; modules that they name must be there."""


@dataclass(frozen=True)
class Block:
    """A fenced block: kind, text, and the line of the page on which the text starts."""

    page: Path
    line: int
    kind: str
    text: str

    @property
    def file(self) -> str | None:
        """The file that the block is the content of: named in a comment that is its whole first line."""
        first = self.text.partition("\n")[0]
        name = first.removeprefix("# ")
        return name if first != name and "." in name and " " not in name else None


def blocks(page: Path) -> Iterator[Block]:
    """Yield the fenced blocks of a page, in order."""
    for token in MarkdownIt().parse(page.read_text(encoding="utf-8")):
        if token.type == "fence" and token.map is not None:
            yield Block(page, token.map[0] + 2, token.info.strip(), token.content)


def commands(block: Block) -> list[list[str]]:
    """Return the words of every command of a shell block; a backslash joins lines, ``#`` starts a comment."""
    lines = block.text.replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def left_out(words: list[str]) -> str | None:
    """Return why a command is not run; None for one that is."""
    for first, reason in LEFT_OUT.items():
        *start, last = words[: len(first)]
        if start == list(first[:-1]) and (last == first[-1] or last.startswith(f"{first[-1]}.")):
            return reason
    return None


def carry_out(block: Block, names: dict[str, Any], boltlaw: Callable[..., Any], done: set[str]) -> None:
    """Carry a block out in the current folder: write its file, run its Python, or its commands.

    Commands in ``done`` are those that another page runs.
    """
    if block.file is not None:
        path = Path(block.file)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.text, encoding="utf-8")
    elif block.kind == "python":
        code = compile("\n" * (block.line - 1) + block.text, str(block.page), "exec")
        exec(code, names)  # the page's own example
    elif block.kind == "toml":
        tomllib.loads(block.text)
    elif block.kind == "sh":
        for words in commands(block):
            _run(words, boltlaw, done)
    else:
        raise AssertionError(
            f"{block.page.name}, line {block.line}: found a block of kind {block.kind!r}, "
            f"expected python, sh, toml or {', '.join(SHOWN)}"
        )


def _run(words: list[str], boltlaw: Callable[..., Any], done: set[str]) -> None:
    if left_out(words):
        if words[:2] == ["python", "-m"]:
            assert find_spec(words[2]), f"there is no module {words[2]}"
    elif words[:2] == ["python", "-m"]:
        import runpy

        sys.argv = words[2:]
        runpy.run_module(words[2], run_name="__main__")
    else:
        assert words[0] == "boltlaw", f"no test knows how to run {shlex.join(words)}"
        if shlex.join(words) not in done:
            ran = boltlaw(*words[1:])
            assert ran.code == 0, ran.err
