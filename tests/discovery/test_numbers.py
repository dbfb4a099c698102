"""Numbers that decide are criteria: a module has none of its own but those marked as `Numerical`."""

from __future__ import annotations

import ast
import re
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


def test_no_module_has_a_number_that_decides() -> None:
    assert all(any(path.is_relative_to(folder) for path in SOURCES) for folder in FOLDERS)
    assert [
        f"{path}: {name}" for path in SOURCES for name in unmarked(path.read_text(encoding="utf-8"))
    ] == []


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


def syntax_trees() -> dict[str, ast.Module]:
    """Of every module of the two packages, by its name."""
    return {
        ".".join(path.relative_to(package.parent).with_suffix("").parts): ast.parse(path.read_text("utf-8"))
        for package in (DISCOVERY, ROM)
        for path in sorted(package.rglob("*.py"))
    }


def with_default_criteria(tree: ast.Module) -> dict[str, tuple[str, int]]:
    """Functions whose criteria have a default: name and place of that argument, by the function's name."""
    found = {}
    for one in tree.body:
        if isinstance(one, ast.FunctionDef):
            given = one.args
            pairs = [
                *zip(given.args[::-1], given.defaults[::-1], strict=False),
                *zip(given.kwonlyargs, given.kw_defaults, strict=True),
            ]
            for argument, default in pairs:
                if default is not None and re.match(r"(RECORD_)?CRITERIA\b", ast.unparse(default)):
                    found[one.name] = (argument.arg, ([*given.args, argument]).index(argument))
    return found


def forgetful(module: str, tree: ast.Module, takers: dict[str, dict[str, tuple[str, int]]]) -> Iterator[str]:
    """Calls of such functions that leave the default in place."""
    known = {name: (module, name) for name in takers[module]}
    for one in ast.walk(tree):
        if isinstance(one, ast.ImportFrom) and one.module:
            known |= {alias.asname or alias.name: (one.module, alias.name) for alias in one.names}
    for call in (one for one in ast.walk(tree) if isinstance(one, ast.Call)):
        home, name = known.get(ast.unparse(call.func), ("", ""))
        if isinstance(call.func, ast.Attribute):
            home, name = ".".join(known.get(ast.unparse(call.func.value), ("", ""))), call.func.attr
        argument, place = takers.get(home, {}).get(name, ("", -1))
        starred = any(isinstance(one, ast.Starred) for one in call.args)
        if len(call.args) <= place and not starred and argument not in {one.arg for one in call.keywords}:
            yield f"{module}:{call.lineno} {ast.unparse(call)}"


def test_criteria_that_are_given_are_handed_on() -> None:
    trees = syntax_trees()
    takers = {module: with_default_criteria(tree) for module, tree in trees.items()}
    assert sum(map(len, takers.values())) > 30
    assert [line for module, tree in trees.items() for line in forgetful(module, tree, takers)] == []


def test_criteria_that_are_not_handed_on_are_found() -> None:
    of = {"a": "def f(x, criteria=CRITERIA): ...", "b": "import c\nfrom a import f\nf(1, 2)\nf(3)\nc.f(4)"}
    trees = {module: ast.parse(text) for module, text in of.items()}
    takers = {module: with_default_criteria(tree) for module, tree in trees.items()}
    assert list(forgetful("b", trees["b"], takers)) == ["b:4 f(3)"]


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
