"""What tests of several commands share."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import Boltlaw, Ran
from tests.shared import Shared


@pytest.fixture
def discovered(rig_campaign: Path, shared: Shared, boltlaw: Boltlaw) -> tuple[Path, Ran]:
    """What `boltlaw discover` writes for the rig's campaign and prints: run once for all tests."""

    def work() -> tuple[Path, Ran]:
        folder = shared.new_folder() / "results"
        return folder, boltlaw("discover", rig_campaign, "--out", folder, "--jobs", 2, "--seed", 7)

    return shared.once("rig ranking", work)
