"""What tests of the closed loop leave out where they do not look at it."""

from __future__ import annotations

from importlib import import_module

import pytest


@pytest.fixture
def without_detection_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to half of a loop; others have them, as the tutorial's has, and `tests/discovery/detection`."""
    monkeypatch.setattr(import_module("discovery.loop.close_loop"), "_detection_limits", lambda *_: ())
