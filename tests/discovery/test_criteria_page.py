"""The page of criteria is what the command prints."""

from __future__ import annotations

import pytest

from discovery.criteria.__main__ import groups, main
from tests.documents.blocks import REPOSITORY

PAGE = REPOSITORY / "docs" / "criteria.md"


def test_the_page_is_what_the_command_prints(capsys: pytest.CaptureFixture[str]) -> None:
    main()
    assert capsys.readouterr().out == PAGE.read_text(encoding="utf-8")


def test_every_number_has_a_row_with_its_value() -> None:
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    for group in groups().values():
        for name, value, unit, *_ in group.rows():
            assert any(line.startswith(f"| `{name}` | {value:.6g} | {unit} |") for line in lines), name
