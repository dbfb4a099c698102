"""Modules and files that pages name are there."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest

from tests.documents.blocks import PAGES, REPOSITORY, blocks

MAINTAINERS = (REPOSITORY / "CONTRIBUTING.md", REPOSITORY / "CHANGELOG.md")
PACKAGES = ("rom", "discovery", "experiments")
_MODULE = re.compile(r"(?<![\w./-])((?:rom|discovery|experiments|benchmarks)(?!\.md\b)(?:\.\w+)+)")
_FILE = re.compile(r"(?<![\w./<-])((?:rom|discovery|experiments|benchmarks|tests|docs)/[\w./-]*\w/?)")


def names(text: str, pattern: re.Pattern[str]) -> set[str]:
    return set(pattern.findall(text))


def is_there(name: str) -> bool:
    """Whether a dotted name is a module, or something that one holds."""
    parts = name.split(".")
    for last in range(len(parts), 0, -1):
        try:
            held = importlib.import_module(".".join(parts[:last]))
        except ModuleNotFoundError as error:
            if not ".".join(parts[:last]).startswith(str(error.name)):
                raise
            continue
        for attribute in parts[last:]:
            held = getattr(held, attribute, None)
        return held is not None
    return False


@pytest.mark.parametrize("page", [*PAGES, *MAINTAINERS], ids=lambda page: page.name)
def test_modules_and_files_that_a_page_names_are_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    missing = {name for name in names(text, _MODULE) if not is_there(name)}
    missing |= {name for name in names(text, _FILE) if not (REPOSITORY / name).exists()}
    assert missing == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_examples_import_is_there(page: Path) -> None:
    """Without running the page, which may take minutes."""
    imports = [
        node
        for block in blocks(page)
        if block.kind == "python"
        for node in ast.walk(ast.parse(block.text))
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith(PACKAGES)
    ]
    imported = [f"{node.module}.{alias.name}" for node in imports for alias in node.names]
    assert [name for name in imported if not is_there(name)] == []


def test_a_name_that_is_not_there_is_noticed() -> None:
    assert not is_there("rom.model.laws.no_such_law")
    assert not is_there("discovery.no_such_module")
    assert is_there("rom.model.laws.power_loosening")
    assert names("see `rom.model.laws`, rom/effects/ and docs/effects.md.", _MODULE) == {"rom.model.laws"}
    assert names("see `rom.model.laws`, rom/effects/ and docs/effects.md.", _FILE) == {
        "rom/effects/",
        "docs/effects.md",
    }
