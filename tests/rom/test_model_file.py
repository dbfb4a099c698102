"""Values that a model.json cannot hold are said by the section of the file, not by Python."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rom.model.rate_uncertainty import RateUncertainty
from rom.model_file import ModelFileError, load_model
from rom.parameters.he_2025 import paper_model


@pytest.mark.parametrize(
    ("section", "keys", "value"),
    [
        ("filter", ("filter", "cutoff_hz"), {"coupled": "fast"}),
        ("filter", ("filter", "cutoff_hz"), {"coupled": 10**400}),
        ("rate_uncertainty", ("rate_uncertainty", "parameters"), [None]),
        ("rate_uncertainty", ("rate_uncertainty", "covariance"), [[float("nan")]]),
    ],
)
def test_what_a_model_file_cannot_hold_is_said_by_its_section(
    tmp_path: Path, section: str, keys: tuple[str, str], value: Any
) -> None:
    known = RateUncertainty.of(["gamma_d"], [[1e-4]], (0.1, 0.0), 5)
    replace(paper_model(), rate_uncertainty=known).save(tmp_path / "model.json")
    data = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    data[keys[0]][keys[1]] = value
    (tmp_path / "model.json").write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(ModelFileError, match=rf"model\.json: {section}: .*, found "):
        load_model(tmp_path / "model.json")


def test_a_number_beyond_all_floats_in_a_model_file_is_said_by_its_section(tmp_path: Path) -> None:
    paper_model().save(tmp_path / "model.json")
    data = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    data["bodies"][0]["mass"]["value"] = 10**400
    (tmp_path / "model.json").write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(ModelFileError, match=r"model\.json: bodies: .*, found "):
        load_model(tmp_path / "model.json")
