"""The sdist, the wheel that is made from it, and the program that the wheel installs."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path
from shutil import copytree, ignore_patterns

import pytest

import rom
from tests.shared import Shared

REPOSITORY = Path(__file__).parents[2]
PACKAGES = ("rom", "discovery", "experiments")
NOT_SOURCE = ignore_patterns(
    ".*", "__pycache__", "*.egg-info", "build", "dist", "demo", "_build", "*-results", "*.pyc"
)
BUILD = "import sys; from setuptools import build_meta as b; print(getattr(b, sys.argv[1])('dist'))"


def python(*arguments: str, folder: Path, program: Path | str = sys.executable) -> str:
    """Run Python in a folder, with no module of the repository in reach, and return what it prints."""
    surroundings = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    ran = subprocess.run(
        [program, *arguments], cwd=folder, env=surroundings, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


@pytest.fixture(scope="session")
def built(shared: Shared) -> tuple[Path, Path]:
    """The sdist, and the wheel made from it alone."""

    def work() -> tuple[Path, Path]:
        sources = shared.new_folder() / "sources"
        copytree(REPOSITORY, sources, ignore=NOT_SOURCE)
        sdist = sources / "dist" / python("-c", BUILD, "build_sdist", folder=sources).split()[-1]
        unpacked = shared.new_folder()
        with tarfile.open(sdist) as archive:
            archive.extractall(unpacked, filter="data")
        (folder,) = unpacked.iterdir()
        return sdist, folder / "dist" / python("-c", BUILD, "build_wheel", folder=folder).split()[-1]

    return shared.once("distribution", work)


@pytest.fixture(scope="session")
def environment(built: tuple[Path, Path], shared: Shared) -> Path:
    """The programs of a new environment with this wheel; its dependencies are those of the present one."""

    def work() -> Path:
        place = shared.new_folder() / "environment"
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", place], check=True)
        programs = Path(sysconfig.get_path("scripts", "venv", {"base": str(place)}))
        packages = Path(sysconfig.get_path("purelib", "venv", {"base": str(place)}))
        (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
        pip = ["-m", "pip", "--python", str(programs / "python"), "install", "--quiet"]
        python(*pip, "--no-index", "--no-deps", "--ignore-installed", str(built[1]), folder=place)
        return programs

    return shared.once("environment", work)


def sources(package: str) -> set[str]:
    """Every file of a package in the repository."""
    paths = (path for path in (REPOSITORY / package).rglob("*") if path.is_file())
    return {path.relative_to(REPOSITORY).as_posix() for path in paths if "__pycache__" not in path.parts}


def test_the_wheel_has_every_file_of_the_packages_and_nothing_else(built: tuple[Path, Path]) -> None:
    with zipfile.ZipFile(built[1]) as wheel:
        names = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert names == set().union(*map(sources, PACKAGES))
    assert {f"{package}/py.typed" for package in PACKAGES} <= names
    assert "experiments/report/page.html.j2" in names


def test_the_sdist_has_what_the_checks_need(built: tuple[Path, Path]) -> None:
    with tarfile.open(built[0]) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()}
    assert {"Makefile", "CITATION.cff", "CHANGELOG.md", "docs/conf.py", "docs/tutorial.md"} <= names
    assert {"tests/conftest.py", "benchmarks/__init__.py", "docs/plug-in/pyproject.toml"} <= names
    assert not [name for name in names if name.endswith(".pyc")]


def test_the_installed_program_runs_from_another_folder(environment: Path, tmp_path: Path) -> None:
    python_of, boltlaw = environment / "python", environment / "boltlaw"
    place = python("-c", "import rom; print(rom.__file__)", folder=tmp_path, program=python_of)
    assert Path(place.strip()).is_relative_to(environment.parent)
    rom.paper_model().save(tmp_path / "model.json")
    assert "report.html" in python("report", ".", folder=tmp_path, program=boltlaw)  # its template is there
    assert "<html" in (tmp_path / "report.html").read_text(encoding="utf-8")
    version = python("--version", folder=tmp_path, program=boltlaw)
    assert version.startswith("boltlaw ")
    assert "unknown" not in version
    as_module = python("-m", "experiments.cli", "--version", folder=tmp_path, program=python_of)
    assert as_module == version
