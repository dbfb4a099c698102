from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from discovery.ranking.discover import _given, _left_out
from discovery.ranking.specimens import _held_out
from rom.identification.reduce import ReducedRecord
from rom.model.laws import Parameter, free_form_law
from rom.signals.quality import Doubt


def test_columns_that_no_sparse_fit_could_take_are_named() -> None:
    assert _left_out(()) == ()
    (few,) = _left_out(("abs(D v) T", "abs(D v)^2 T"))
    assert few.endswith("multiples of others: abs(D v) T; abs(D v)^2 T")
    (many,) = _left_out([f"abs(x)^{q} T" for q in range(9)])
    assert many.endswith("abs(x)^4 T and 4 more")


def test_a_held_out_record_of_doubtful_quality_is_told_not_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    doubt = Doubt("records/loosening_005.h5", "force_lo", "clipped", "force_lo is clipped")
    settings: Any = SimpleNamespace(file=doubt.file)
    reduced = [ReducedRecord(settings, (doubt,))]
    monkeypatch.setattr(
        sys.modules["discovery.ranking.specimens"], "reduce_records", lambda *_: iter(reduced)
    )
    campaign: Any = SimpleNamespace(select=lambda *_, **__: [settings], settings=None)
    found: Any = SimpleNamespace(course_noise=None)
    assert _held_out(campaign, found, 1, lambda _: None) == ((), (doubt,))


def test_a_law_cannot_have_the_name_of_a_standing_one() -> None:
    law = free_form_law("no loosening", "-a * abs(v) * T", "tension rate", {"a": Parameter(1.0, "1/m")})
    with pytest.raises(ValueError, match="found the name of a standing law, expected another name"):
        _given([law])
