"""What costs much and serves several tests, computed once for all processes of a test run."""

from __future__ import annotations

import fcntl
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, cast

import pytest

Found = TypeVar("Found")


@dataclass(frozen=True)
class Shared:
    """Results by name in a folder that every process of the run sees."""

    folder: Path

    @classmethod
    def of_run(cls, factory: pytest.TempPathFactory, worker: str) -> Shared:
        """The folder of this run: workers of pytest-xdist have their own one level below it."""
        base = factory.getbasetemp()
        folder = (base if worker == "master" else base.parent) / "shared"
        folder.mkdir(exist_ok=True)
        return cls(folder)

    def once(self, name: str, work: Callable[[], Found]) -> Found:
        """What ``work()`` returns: of the process that comes first; the others wait for it and read."""
        result = self.folder / f"{name}.pickle"
        with (self.folder / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # let go when the file is closed, or its process ends
            if not result.exists():
                found = work()
                temporary = result.with_suffix(".part")
                temporary.write_bytes(pickle.dumps(found))
                temporary.replace(result)
            return cast(Found, pickle.loads(result.read_bytes()))
