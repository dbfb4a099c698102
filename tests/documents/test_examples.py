"""The example in every command's help: one line, as printed a line of a page that is run, or run here."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from experiments.cli import app
from experiments.studies import rig
from tests.documents.blocks import left_out
from tests.documents.test_pages import tutorial_commands

Boltlaw = Callable[..., Any]
EXAMPLES = {
    command.name or getattr(command.callback, "__name__", ""): (command.epilog or "").removeprefix(
        "Example: "
    )
    for command in app.registered_commands
}
ON_A_PAGE = {
    *tutorial_commands(),
    "boltlaw compare rig-campaign laws.toml",  # own-law.md has it, with --out
    "boltlaw run experiment.toml",  # experiments.md
}
ALONE = [
    name
    for name, example in EXAMPLES.items()
    if example not in ON_A_PAGE and not left_out(shlex.split(example))
]


@pytest.mark.parametrize("name", EXAMPLES)
def test_help_prints_the_example_on_a_line_of_its_own(
    name: str, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw
) -> None:
    """Two clicks copy it: it is not broken at the width of a terminal."""
    monkeypatch.setenv("COLUMNS", "80")
    ran = boltlaw(name, "--help")
    assert re.search(rf"^ *(?:Example: )?{re.escape(EXAMPLES[name])}$", ran.out, re.MULTILINE), ran.out
    assert EXAMPLES[name].startswith(f"boltlaw {name} ")


def test_most_examples_are_lines_of_the_tutorial() -> None:
    assert set(ALONE) <= {"rig", "reproduce"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ALONE)
def test_an_example_that_no_page_runs_runs_as_printed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw
) -> None:
    """Where it says nothing of their length, records of 3 s stand for the paper's of 8.5 s."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rig, "run", partial(rig.run, duration_s=3.0))
    ran = boltlaw(*shlex.split(EXAMPLES[name])[1:])
    assert ran.code == 0, ran.err
    assert "wrote" in ran.out
    assert list(tmp_path.iterdir())
