"""What costs much and serves several tests, computed once for all processes of a test run."""

from __future__ import annotations

import fcntl
import hashlib
import pickle
import tempfile
from collections.abc import Callable, Hashable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial, wraps
from pathlib import Path
from typing import ClassVar, ParamSpec, TypeVar, cast

import pytest

Found = TypeVar("Found")
Asked = ParamSpec("Asked")
REPOSITORY = Path(__file__).parents[1]


def measured(folder: str) -> Path:
    """Return a folder of data that others measured, beside the repository; skip the test where it is not."""
    places = [parent / "shared" / "data" / folder for parent in REPOSITORY.parents[:2]]
    for place in places:
        if place.is_dir():
            return place
    pytest.skip(f"measured data are not part of the project: found no folder {places[0]}")


@dataclass(frozen=True)
class Shared:
    """Results by name in a folder that every process of the run sees."""

    folder: Path
    here: ClassVar[Shared]  # of the run that goes on

    @classmethod
    def of_run(cls, factory: pytest.TempPathFactory, worker: str) -> Shared:
        """The folder of this run: workers of pytest-xdist have their own one level below it."""
        base = factory.getbasetemp()
        folder = (base if worker == "master" else base.parent) / "shared"
        folder.mkdir(exist_ok=True)
        return cls(folder)

    def once(self, name: str, work: Callable[[], Found]) -> Found:
        """What ``work()`` returns: of the process that comes first; the others wait for it and read."""
        self._worked(name, work, fcntl.LOCK_EX)
        return cast(Found, pickle.loads(self._result(name).read_bytes()))

    def new_folder(self) -> Path:
        """An empty folder that every process of the run may read from."""
        return Path(tempfile.mkdtemp(dir=self.folder))

    def all(self, works: Mapping[str, Callable[[], Found]]) -> list[Found]:
        """The results of all, in order: first whatever nobody is at, so that processes share the work."""
        for name, work in works.items():
            with suppress(BlockingIOError):
                self._worked(name, work, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return [self.once(name, work) for name, work in works.items()]

    def _result(self, name: str) -> Path:
        return self.folder / f"{name}.pickle"

    def _worked(self, name: str, work: Callable[[], object], lock_as: int) -> None:
        """See to it that the result is there. A lock is let go when its file closes or its process ends."""
        with self._result(name).with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, lock_as)
            if not self._result(name).exists():
                part = self._result(name).with_suffix(".part")
                part.write_bytes(pickle.dumps(work()))
                part.replace(self._result(name))


def once_per_run(work: Callable[Asked, Found]) -> Callable[Asked, Found]:
    """Decorate a function of few arguments: one process of the run computes it, every other one reads.

    Arguments are told apart by their text; nobody may change what is returned.
    """

    @wraps(work)
    def known(*arguments: Asked.args, **options: Asked.kwargs) -> Found:
        asked = f"{work.__module__} {work.__qualname__} {arguments} {sorted(options.items())}"
        name = f"{work.__name__} {hashlib.sha256(asked.encode()).hexdigest()[:16]}"
        return Shared.here.once(name, partial(work, *arguments, **options))

    return cast(Callable[Asked, Found], cache(cast(Callable[..., Hashable], known)))
