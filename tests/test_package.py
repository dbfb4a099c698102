"""The package as others see it: light to import, public names at their place, modules of a readable size."""

from __future__ import annotations

import importlib
import inspect
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


def test_functions_take_as_many_processes_as_commands_where_nobody_says(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    import discovery
    import experiments
    import rom
    from rom import jobs

    monkeypatch.setattr(jobs, "CORES", 6)
    functions = (rom.read_campaign, rom.identify, discovery.discover, discovery.compare, discovery.close_loop)
    for function in (*functions, experiments.run_experiment):
        assert inspect.signature(function).parameters["jobs"].default is None
    (tmp_path / "record").write_bytes(bytes(1000))
    assert (jobs.processes(None), jobs.processes(2)) == (6, 2)
    assert jobs.processes_for(None, [tmp_path / "record", tmp_path / "none"]) == 1
    monkeypatch.setattr(jobs, "_FEW_BYTES", 100)
    assert jobs.processes_for(None, [tmp_path / "record"]) == 6
    monkeypatch.setattr(jobs.multiprocessing, "parent_process", object)
    assert jobs.processes(None) == 1  # none of a process that works for another


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
