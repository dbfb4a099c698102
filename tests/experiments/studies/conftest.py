"""What tests of several commands share."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.conftest import Boltlaw, Ran
from tests.discovery import driven_twins as twins
from tests.experiments.studies.experiment_files import SMALL
from tests.shared import Shared


@pytest.fixture
def discovered(rig_campaign: Path, shared: Shared, boltlaw: Boltlaw) -> tuple[Path, Ran]:
    """What `boltlaw discover` writes for the rig's campaign and prints: run once for all tests."""

    def work() -> tuple[Path, Ran]:
        folder = shared.new_folder() / "results"
        return folder, boltlaw(
            "discover", rig_campaign, "--out", folder, "--jobs", 2, "--seed", 7, figures=True
        )

    return shared.once("rig ranking", work)


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two small campaigns of a cycled contact."""
    folder = tmp_path_factory.mktemp("campaigns")
    for seed, name in enumerate(("one", "two")):
        twins.cycled(folder / name, friction=0.0, seed=seed, seconds=3.0)
    return folder


@pytest.fixture
def file(campaigns: Path, tmp_path: Path) -> Path:
    """An experiment of two cells on each of two campaigns."""
    for name in ("one", "two"):
        shutil.copytree(campaigns / name, tmp_path / name)
    path = tmp_path / "slip.toml"
    path.write_text(SMALL)
    return path
