"""Fixtures that import one file and tell what became of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from scipy.io import savemat

from tests.experiments.datasets.lab_case import ACCELERATION, CHANNELS, FORCE, Outcome, Put, imported


@pytest.fixture
def matlab(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Put:
    """Import a MATLAB file of F, A and more."""

    def put(
        more: Mapping[str, Any], rules: Mapping[str, str] | None = None, motion_hz: float = 19200
    ) -> Outcome:
        (tmp_path / "lab").mkdir()
        savemat(tmp_path / "lab" / "a.mat", {"F": FORCE, "A": ACCELERATION, **more}, long_field_names=True)
        return imported(capfd, tmp_path / "lab", "matlab", {**CHANNELS, **(rules or {})}, motion_hz)

    return put


@pytest.fixture
def tdms(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Put:
    """Import a TDMS file of channels by name: samples, properties, and the group."""

    def put(
        channels: Mapping[str, Any], rules: Mapping[str, str] | None = None, motion_hz: float = 19200
    ) -> Outcome:
        import nptdms

        (tmp_path / "lab").mkdir()
        objects = [
            nptdms.ChannelObject(group, name, samples, properties)
            for name, (samples, properties, group) in channels.items()
        ]
        with nptdms.TdmsWriter(str(tmp_path / "lab" / "a.tdms")) as writer:
            writer.write_segment(objects)
        return imported(capfd, tmp_path / "lab", "tdms", {**CHANNELS, **(rules or {})}, motion_hz)

    return put
