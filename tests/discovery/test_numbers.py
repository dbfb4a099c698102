"""Numbers that decide are criteria: a module has none of its own but those marked as `Numerical`."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import discovery
import rom
from discovery.criteria.criteria import CRITERIA
from discovery.ranking.cross_validation import preload_groups
from discovery.ranking.ordering import order
from tests.discovery.synthetic import small

DISCOVERY, ROM = (Path(package.__file__).parent for package in (discovery, rom))
ROOMS = (
    "laws",
    "courses",
    "search",
    "ranking",
    "separating_tests",
    "decide",
    "loop",
    "residual",
    "explain",
    "localisation",
    "views",
)
OF_ROM = ("signals", "identification", "evaluation")  # what is read, modelled or shown decides nothing
FOLDERS = [*(DISCOVERY / room for room in ROOMS), *(ROM / room for room in OF_ROM)]
SOURCES = [path for folder in FOLDERS for path in sorted(folder.glob("*.py"))]


def unmarked(text: str) -> Iterator[str]:
    """Names of numeric constants of a module that are not annotated as ``Numerical``."""
    for line in ast.parse(text).body:
        if isinstance(line, ast.Assign) and _is_number(line.value):
            yield from (ast.unparse(target) for target in line.targets)
        if isinstance(line, ast.AnnAssign) and line.value is not None and _is_number(line.value):
            marked = ast.unparse(line.annotation).startswith("Numerical[")
            yield from () if marked else (ast.unparse(line.target),)


def _is_number(value: ast.expr) -> bool:
    """Whether an expression holds a number and no name of a class or table: literals, tuples, arithmetic."""
    if isinstance(value, ast.Dict | ast.DictComp | ast.Lambda):
        return False
    plain = ("float", "int", "tuple", "np.")
    if isinstance(value, ast.Call) and not ast.unparse(value.func).startswith(plain):
        return False
    return any(
        isinstance(one, ast.Constant)
        and isinstance(one.value, int | float)
        and not isinstance(one.value, bool)
        for one in ast.walk(value)
    )


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: "/".join(path.parts[-3:]))
def test_no_module_has_a_number_that_decides(path: Path) -> None:
    assert list(unmarked(path.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    "line",
    [
        "A = 3",
        "A: float = 2.0",
        "A = -1e-3",
        "A, B = 2.0, 1.0",
        "A = float(np.log(20.0))",
        "A = (12, 32, 200.0)",
        "A = np.arange(-0.15, 0.151, 0.05)",
    ],
)
def test_a_number_that_is_not_marked_is_found(line: str) -> None:
    assert len(list(unmarked(line))) == 1


def test_a_number_that_is_marked_or_a_text_is_not() -> None:
    assert not list(unmarked("A: Numerical[int] = 3\nB = 'text'\nC = ('x', 'v')"))


def test_another_criterion_changes_what_is_kept_and_the_default_does_not() -> None:
    scores = np.array([np.zeros(12), np.full(12, -0.2)])
    evidence = np.array([np.zeros(12), np.full(12, 0.2)])
    groups = np.arange(12)
    sizes = [(2, 9), (3, 9)]
    loose, strict = replace(CRITERIA.ranking, log_odds=3.0), replace(CRITERIA.ranking, log_odds=1.0)
    assert order(scores, evidence, sizes, groups) == order(scores, evidence, sizes, groups, loose) == [1, 0]
    assert order(scores, evidence, sizes, groups, strict) == [0, 1]


def test_a_folds_criterion_travels_with_the_frozen_motion() -> None:
    whole = small()
    merged = replace(whole, criteria=CRITERIA.changed(ranking={"same_preload": 1e3}))
    assert len(set(preload_groups(whole).tolist())) > 1
    assert set(preload_groups(merged).tolist()) == {0}
