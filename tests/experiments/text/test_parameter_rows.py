"""Rows of a table of parameters."""

from __future__ import annotations

import pytest

from discovery.views.closure_file import parameter_row
from experiments.text.tables import parameter_rows, parameters_table
from rom.model.laws import Parameter


@pytest.mark.parametrize(
    ("limits", "source"),
    [
        ({}, "Kerschen et al."),
        ({"low": None, "high": None}, "Kerschen et al."),
        ({"low": 6.26e10, "high": 6.27e10}, "identified"),
        ({"low": 0.0, "high": None}, "identified"),
    ],
)
def test_a_value_with_limits_is_not_the_catalogues(limits: dict[str, float | None], source: str) -> None:
    number = {"value": 6.27e10, "unit": "N/m3", "source": "Kerschen et al."} | limits
    (row,) = parameter_rows("cubic-stiffness at joint", {"k3": number})
    assert row[-1] == source


def test_a_parameter_without_limits_has_none() -> None:
    assert parameter_row(Parameter(4.0, "1")) == {"value": 4.0, "low": None, "high": None, "unit": "1"}


def test_a_note_says_what_stands_in_the_table() -> None:
    limited = {"value": 1.0, "low": 0.9, "high": 1.1, "unit": "kg"}
    known = {
        "bodies": [{"name": "a", "mass": limited}],
        "effects": [{"name": "x", "parameters": {"k": limited}}],
    }
    open_ = {"bodies": [{"name": "a", "mass": {"value": 1.0, "unit": "kg"}}]}
    again = ({"name": "body.a.mass", **limited},)
    notes = [parameters_table(*of) for of in ((known,), (open_,), (known, "model", again))]
    assert [table.note for table in notes if table] == [
        "",
        "A dash: no limits are known.",
        "Numbers of links were fitted again beside the effects.",
    ]
