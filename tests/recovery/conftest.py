"""What the tests of recovery share."""

from __future__ import annotations

import pytest

from tests.recovery.shared import Shared


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Shared:
    return Shared.of_run(tmp_path_factory, worker_id)
