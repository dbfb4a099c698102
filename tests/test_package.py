"""The package as others see it: light to import, public names at their place, modules of a readable size."""

from __future__ import annotations

import importlib
import inspect
import os
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
HEAVY = (
    "numba", "matplotlib", "pandas", "h5py", "scipy", "sklearn", "pysindy", "pydantic", "joblib", "bokeh",
)  # fmt: skip


def imported_by(statement: str) -> set[str]:
    """Return the packages that a statement loads into a fresh interpreter."""
    code = f"{statement}; import sys; print(*{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def test_importing_rom_loads_nothing_heavy() -> None:
    assert imported_by("import rom").isdisjoint(HEAVY)


def test_reading_a_model_needs_no_plotting_and_no_file_formats() -> None:
    loaded = imported_by("import rom; rom.load_model; rom.paper_model(); rom.Model")
    assert loaded.isdisjoint({"numba", "matplotlib", "pandas", "h5py", "pysindy"})


def test_the_program_shows_its_help_without_loading_the_science() -> None:
    loaded = imported_by("import experiments.cli as cli; cli.run(['identify', '--help'])")
    assert loaded.isdisjoint({"numba", "matplotlib", "pandas", "h5py", "scipy", "pysindy", "bokeh"})


def test_functions_say_where_a_command_takes_other_processes_by_default() -> None:
    import discovery
    import rom
    from experiments import cli

    for function in (rom.identify, discovery.discover, discovery.close_loop):
        command = {"close_loop": "close"}.get(function.__name__, function.__name__)
        here, there = (
            inspect.signature(one).parameters["jobs"].default for one in (function, getattr(cli, command))
        )
        assert (here, there) == (1, os.cpu_count())
        assert "(the command takes all cores by default" in " ".join((function.__doc__ or "").split())


@pytest.mark.parametrize(
    "name", ["read_campaign", "write_campaign", "identify", "paper_model", "load_model", "Model", "Campaign"]
)
def test_a_public_name_is_there_and_explained(name: str) -> None:
    import rom

    member = getattr(rom, name)
    assert inspect.getdoc(member)
    assert name in dir(rom)


def test_a_name_that_is_not_there_is_answered_with_those_that_are() -> None:
    import rom

    with pytest.raises(AttributeError, match=r"no attribute 'identfy'; it has .*identify"):
        _ = rom.identfy


def test_a_model_has_the_methods_that_others_call() -> None:
    import rom

    model = rom.paper_model()
    assert list(inspect.signature(model.simulate).parameters)[:3] == ["force", "rate_hz", "initial_tension"]
    assert list(inspect.signature(model.final_tension).parameters)[:3] == [
        "forces",
        "rate_hz",
        "initial_tension",
    ]
    assert callable(model.save)


@pytest.mark.parametrize("package", ["rom", "experiments", "discovery", "benchmarks", "tests"])
def test_no_module_is_too_long_to_read(package: str) -> None:
    lengths = {
        str(path.relative_to(REPOSITORY)): len(path.read_text(encoding="utf-8").splitlines())
        for path in (REPOSITORY / package).rglob("*.py")
    }
    assert {path: length for path, length in lengths.items() if length > 400} == {}


@pytest.mark.parametrize("package", ["rom", "experiments", "discovery"])
def test_every_module_says_what_it_is_for(package: str) -> None:
    for path in (REPOSITORY / package).rglob("*.py"):
        name = ".".join(path.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__")
        assert importlib.import_module(name).__doc__, name
