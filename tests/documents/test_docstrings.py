"""Public functions with three or more arguments say what each of them is."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
MODULES = [
    p for package in ("rom", "discovery", "experiments") for p in sorted((ROOT / package).rglob("*.py"))
]
Function = ast.FunctionDef | ast.AsyncFunctionDef


def public_functions(body: list[ast.stmt]) -> Iterator[tuple[Function, list[str]]]:
    """Functions and methods with their arguments, those of private classes left out."""
    for one in body:
        if isinstance(one, ast.ClassDef) and not one.name.startswith("_"):
            yield from public_functions(one.body)
        if isinstance(one, Function) and not one.name.startswith("_"):
            given = one.args
            named = [arg.arg for arg in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
            extra = [f"{stars}{arg.arg}" for stars, arg in (("*", given.vararg), ("**", given.kwarg)) if arg]
            yield one, [name for name in (*named, *extra) if name not in ("self", "cls")]


def excused(function: Function, arguments: list[str]) -> bool:
    """Whether arguments are told elsewhere, or at greater length than the function has.

    Commands have a help text for every option. What only carries out a method of a model or of a campaign's
    fits begins with "See" and names it. A compiled helper, inlined into what calls it, may be shorter than
    its section would be.
    """
    decorators = " ".join(ast.unparse(one) for one in function.decorator_list)
    lines = (function.end_lineno or 0) - function.body[0].lineno
    return (
        "app.command" in decorators
        or (ast.get_docstring(function) or "").startswith(("See ``Model.", "See ``CampaignRefits."))
        or ("inline" in decorators and lines < 2 * len(arguments) + 8)
    )


def told(function: Function) -> list[str]:
    """Names in the section Parameters of a docstring, in order."""
    found = re.search(
        r"^Parameters\n-+\n(.*?)(?=\n\n\S|\Z)", ast.get_docstring(function) or "", re.MULTILINE | re.DOTALL
    )
    heads = [line for line in (found[1].splitlines() if found else ()) if line and not line.startswith(" ")]
    return [name.strip() for line in heads for name in line.split(" :")[0].split(",")]


def told_otherwise(path: Path) -> Iterator[str]:
    """Functions of a module whose section Parameters is not about their arguments."""
    for function, arguments in public_functions(ast.parse(path.read_text(encoding="utf-8")).body):
        named = told(function)
        wanted = named or (len(arguments) >= 3 and not excused(function, arguments))
        if wanted and set(named) != set(arguments):
            yield f"{path}:{function.lineno} {function.name}: told {named}, takes {arguments}"


def test_parameters_of_public_functions_are_told() -> None:
    assert len(MODULES) > 300
    assert [line for path in MODULES for line in told_otherwise(path)] == []


def test_what_is_not_told_is_found(tmp_path: Path) -> None:
    text = '''
def f(a, b, *c):
    """Do.

    Parameters
    ----------
    a, b : int
        Numbers.

    Returns
    -------
    int
        One more.
    """


@njit(inline="always")
def g(a, b, c):
    """Add."""
    return a + b + c


def h(a, b, c):
    """Add."""
    return a + b + c
'''
    of = {one.name: (one, arguments) for one, arguments in public_functions(ast.parse(text).body)}
    assert told(of["f"][0]) == ["a", "b"]
    assert of["f"][1] == ["a", "b", "*c"]
    assert excused(*of["g"])
    assert not excused(*of["h"])
    path = tmp_path / "module.py"
    path.write_text(text, encoding="utf-8")
    assert [line.split(": ")[0].split()[-1] for line in told_otherwise(path)] == ["f", "h"]
