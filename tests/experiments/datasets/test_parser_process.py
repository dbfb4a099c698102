"""A parser that ends its process, or never ends, is an unreadable file; the next file is read."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from experiments.datasets import parser_process, vectors
from experiments.datasets.collected import SourceError


def die(_: Path) -> None:
    """End the process."""
    os.kill(os.getpid(), 9)


def die_too(path: Path, names: tuple[str, ...]) -> None:
    """End the process in the place of a parser of variables."""
    assert names
    die(path)


def wait(_: Path) -> None:
    """Never come back."""
    time.sleep(600)


def size(path: Path) -> int:
    """Return the size of a file."""
    return path.stat().st_size


def fail(path: Path) -> None:
    """Raise as a parser does."""
    raise KeyError(path.name)


@pytest.mark.parametrize("parse", [die, wait])
def test_a_parser_that_is_lost_is_an_unreadable_file(
    parse: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(b"abc")
    assert parser_process.parsed_apart(size, path, "file") == 3
    monkeypatch.setattr(parser_process, "LONGEST_S", 0.2 if parse is wait else 15.0)
    with pytest.raises(SourceError, match=r"a\.mat: found it unreadable, expected a sound file"):
        parser_process.parsed_apart(parse, path, "file")  # type: ignore[arg-type]
    monkeypatch.undo()
    assert parser_process.parsed_apart(size, path, "file") == 3


def test_an_exception_of_the_parser_is_its_own(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(b"abc")
    with pytest.raises(KeyError, match=r"a\.mat"):
        parser_process.parsed_apart(fail, tmp_path / "a.mat", "file")


def test_benchmark_files_are_parsed_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.mat").write_bytes(b"abc")
    monkeypatch.setattr(vectors, "_variables", die_too)
    with pytest.raises(SourceError, match=r"a\.mat: found it unreadable"):
        vectors.mat_vectors(tmp_path / "a.mat", ("V1",))
