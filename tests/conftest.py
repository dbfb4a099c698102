"""What tests of several packages share: a small campaign from the virtual rig and its identification."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.shared import Shared


@dataclass(frozen=True)
class Ran:
    """Exit code and printed text of one run of the program."""

    code: int
    out: str
    err: str


Boltlaw = Callable[..., Ran]


@pytest.fixture
def boltlaw(capfd: pytest.CaptureFixture[str]) -> Boltlaw:
    """Run the program within this process."""
    from experiments.cli import run

    def call(*arguments: object) -> Ran:
        capfd.readouterr()
        code = run([str(argument) for argument in arguments])
        return Ran(code, *capfd.readouterr())

    return call


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Shared:
    """Results that every process of the run may use."""
    return Shared.of_run(tmp_path_factory, worker_id)


@pytest.fixture(scope="session", autouse=True)
def machine_code(request: pytest.FixtureRequest, worker_id: str) -> None:
    """Compile what most tests call once for all processes: two that come to it at once would both do so."""
    if worker_id != "master":
        request.getfixturevalue("shared").all({"model's code": _use_the_model, "rig's code": _use_the_rig})


def _use_the_model() -> None:
    from rom.parameters.he_2025 import paper_model

    paper_model().simulate({"lo": np.zeros(64)}, 19200.0, 100.0)


def _use_the_rig() -> None:
    from experiments.rig.excitation import Hit
    from experiments.rig.plant import Plant
    from experiments.rig.simulation import run
    from experiments.rig.undeclared import Undeclared

    for effects in ((), (Undeclared("extra-mode"),)):
        run(Plant(effects=effects), Hit("lo", 1000.0, 0.001, 0.001), 100.0, 0.003)


@pytest.fixture(scope="session")
def rig_campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight preloads, records of 3 s, no scatter of gamma: made once, never changed."""
    from experiments.studies import rig

    return rig.run(
        tmp_path_factory.mktemp("rig") / "campaign", cases=8, seed=1, jobs=1, duration_s=3.0, scatter=0.0
    )


@pytest.fixture(scope="session")
def results(rig_campaign: Path) -> Path:
    """What `boltlaw identify` writes for it, at the default place."""
    from experiments.cli import run

    assert run(["identify", str(rig_campaign), "--jobs", "1", "--quiet"]) == 0
    return rig_campaign.with_name("campaign-results")
