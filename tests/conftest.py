"""What tests of several packages share: a small campaign from the virtual rig and its identification."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, cast

import pytest

from tests.shared import Shared

if TYPE_CHECKING:
    from rom.identification.identify import Identification


@dataclass(frozen=True)
class Ran:
    """Exit code and printed text of one run of the program."""

    code: int
    out: str
    err: str


Boltlaw = Callable[..., Ran]


@pytest.fixture
def boltlaw(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Boltlaw:
    """Run the program within this process, and in no other where a test does not ask for jobs.

    Figures are drawn where a test asks for them: they are most of many a small run.
    """
    from experiments.cli import app, run
    from experiments.studies.figure_files import without_figures

    alone = {
        one.name or one.callback.__name__: {"jobs": 1} for one in app.registered_commands if one.callback
    }
    monkeypatch.setitem(cast(dict[str, object], app.info.context_settings), "default_map", alone)

    def call(*arguments: object, figures: bool = False) -> Ran:
        capfd.readouterr()
        with nullcontext() if figures else without_figures():
            code = run([str(argument) for argument in arguments])
        return Ran(code, *capfd.readouterr())

    return call


@pytest.fixture
def without_detection_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to half of a loop; others have them, as the tutorial's has, and `tests/discovery/detection`."""
    monkeypatch.setattr(import_module("discovery.loop.close_loop"), "_detection_limits", lambda *_: ())


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--seeds", type=int, default=3, help="campaigns of the virtual rig for every law to recover"
    )
    parser.addoption("--every", action="store_true", help="variants too whose statement a cheaper test makes")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is for `make test-all` only; long tests come first, so that no process ends with one."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
    if config.getoption("every"):
        return
    left_out = [item for item in items if item.get_closest_marker("variant")]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if not item.get_closest_marker("variant")]


@pytest.fixture(scope="session", autouse=True)
def alone() -> None:
    """Functions work in this process where a test does not ask for more."""
    from rom import jobs

    jobs.CORES = 1


@pytest.fixture(scope="session", autouse=True)
def shared(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Shared:
    """Results that every process of the run may use."""
    Shared.here = Shared.of_run(tmp_path_factory, worker_id)
    return Shared.here


@pytest.fixture(scope="session")
def rig_campaign(shared: Shared) -> Path:
    """Eight preloads, records of 3 s, no scatter of gamma: made once in a run, never changed."""

    def work() -> Path:
        from experiments.studies import rig

        return rig.run(shared.new_folder() / "campaign", cases=8, seed=1, jobs=1, duration_s=3.0, scatter=0.0)

    return shared.once("rig campaign", work)


@pytest.fixture(scope="session")
def rig_identified(rig_campaign: Path, shared: Shared) -> Identification:
    """What is identified from it."""
    from rom.campaign.campaign import read_campaign
    from rom.identification.identify import identify_campaign

    return shared.once("rig identified", lambda: identify_campaign(read_campaign(rig_campaign), jobs=1))


@pytest.fixture(scope="session")
def results(rig_campaign: Path, shared: Shared) -> Path:
    """What `boltlaw identify` writes for it, at the default place."""

    def work() -> Path:
        from experiments.cli import run

        assert run(["identify", str(rig_campaign), "--jobs", "1", "--quiet"]) == 0
        return rig_campaign.with_name("campaign-results")

    return shared.once("rig results", work)
