"""Result files: the header, no NaN, whole or not at all, at a place that can be written to."""

from __future__ import annotations

import json
import os
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.results import plain, results_folder, writable, write_result
from rom.provenance import versions

HEADER = {"campaign": "two oscillators", "seed": 3, "elapsed_s": 1.23456}


def test_a_result_says_how_it_was_made(tmp_path: Path) -> None:
    path = write_result(tmp_path / "new" / "ranking.json", "ranking", {"laws": [1, 2]}, **HEADER)  # type: ignore[arg-type]
    data = json.loads(path.read_text(encoding="utf-8"))
    assert data == {
        "format": "boltlaw-ranking/1",
        "campaign": "two oscillators",
        "program_version": version("boltlaw"),
        "versions": versions(),
        "seed": 3,
        "elapsed_s": 1.235,
        "laws": [1, 2],
    }
    assert [entry.name for entry in path.parent.iterdir()] == ["ranking.json"]


def test_what_cannot_be_written_leaves_the_old_result(tmp_path: Path) -> None:
    path = tmp_path / "ranking.json"
    path.write_text("old")
    with pytest.raises(TypeError):
        write_result(path, "ranking", {"laws": object()}, **HEADER)  # type: ignore[arg-type]
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["ranking.json"]


def test_units_and_names_keep_their_letters(tmp_path: Path) -> None:
    path = write_result(tmp_path / "a.json", "model", {"name": "Prüfstand γ"}, **HEADER)  # type: ignore[arg-type]
    assert "Prüfstand γ" in path.read_text(encoding="utf-8")


VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=10,
)


@given(VALUES)
def test_anything_becomes_strict_json(value: Any) -> None:
    json.dumps(plain({"value": value}), allow_nan=False)


def test_arrays_become_lists_and_nan_becomes_null() -> None:
    value = {
        "array": np.array([[1.0, np.nan], [np.inf, 2.0]]),
        "number": np.float64(0.5),
        "nan": np.float32(np.nan),
        "count": np.int64(3),
        "yes": np.bool_(True),
        "tuple": (1, float("-inf")),
        "mapping": MappingProxyType({1: "one"}),
    }
    assert plain(value) == {
        "array": [[1.0, None], [None, 2.0]],
        "number": 0.5,
        "nan": None,
        "count": 3,
        "yes": True,
        "tuple": [1, None],
        "mapping": {"1": "one"},
    }


def test_results_go_beside_the_campaign_unless_told_otherwise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = tmp_path / "tests.2024"
    campaign.mkdir()
    (campaign / "campaign.toml").touch()
    beside = tmp_path / "tests.2024-results"
    assert results_folder(campaign, None) == beside
    assert results_folder(campaign / "campaign.toml", None) == beside
    assert results_folder(campaign, tmp_path / "out") == tmp_path / "out"
    monkeypatch.chdir(campaign)
    assert results_folder(Path("."), None) == beside  # noqa: PTH201 - what a person types
    assert not beside.exists()


def test_a_place_for_results_is_looked_at_but_not_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert writable(tmp_path / "a" / "b") == tmp_path / "a" / "b"
    assert not (tmp_path / "a").exists()
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError, match="expected a folder"):
        writable(tmp_path / "file" / "b")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(PermissionError, match="may not be written to"):
        writable(tmp_path / "a")
