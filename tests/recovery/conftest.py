"""How many seeds the virtual rig is asked for."""

from __future__ import annotations

import pytest


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "seed" in metafunc.fixturenames:
        metafunc.parametrize("seed", range(metafunc.config.getoption("seeds")))


@pytest.fixture(scope="session")
def seeds(pytestconfig: pytest.Config) -> range:
    """Of campaigns of the virtual rig, each with a plant, sensors and scatter of its own."""
    return range(pytestconfig.getoption("seeds"))
