"""The case study below 25 N reports the closure that is kept beside it."""

from __future__ import annotations

import json

import pytest

from tests.documents.blocks import REPOSITORY

DOCS = REPOSITORY / "docs"
CLOSURE = json.loads((DOCS / "low-preload" / "closure.json").read_text(encoding="utf-8"))
PAGE = (DOCS / "low-preload.md").read_text(encoding="utf-8")


def row(label: str) -> str:
    return next(line for line in PAGE.splitlines() if line.startswith(f"| {label} |"))


def with_limits(number: dict[str, float], form: str, scale: float = 1.0, power: str = "") -> str:
    value, low, high = (f"{scale * number[key]:{form}}{power}" for key in ("value", "low", "high"))
    return f"{value}, {low} to {high}"


def cells_of(label: str) -> str:
    """A row's number and limits without its unit: "16, 0 to 39"."""
    cell = next(cell for cell in row(label).split("|") if "(" in cell)
    number, _, limits = cell.strip().removesuffix(")").partition(" (")
    return f"{number.split()[0]}, {limits}"


def test_verdict_and_effects() -> None:
    assert CLOSURE["verdict"] == "closed"
    assert [one["name"] for one in CLOSURE["effects"]] == ["one-sided-gap", "tightening"]
    assert not any(one["look_alikes"] for one in CLOSURE["effects"])
    assert [one["p_value"] for one in CLOSURE["effects"]] == [0.002, 0.001]


def test_numbers_and_their_limits() -> None:
    stop, tightening = (one["parameters"] for one in CLOSURE["effects"])
    assert cells_of("stiffness of the stop") == with_limits(stop["k_g"], ".3f", 1e-6, "e6")
    assert cells_of("its distance") == with_limits(stop["delta"], ".2f", 1e6)
    assert cells_of("tightening at 100 N and 50 mm/s") == with_limits(tightening["g_t"], ".0f")
    assert cells_of("its power of the velocity") == with_limits(tightening["q_t"], ".1f")
    assert cells_of("its share of gamma's dependence on tension") == with_limits(tightening["h_t"], ".2f")


def test_residuals_and_errors() -> None:
    before, after = CLOSURE["residual"]["before"], CLOSURE["residual"]["after"]
    for label, old, new in (
        (
            "residual, mean square over noise: 0 to 30 N",
            *(r["by_preload"]["0 to 30 N"] for r in (before, after)),
        ),
        ("all records", before["total"], after["total"]),
    ):
        cells = [float(cell) for cell in row(label).split("|")[2:5]]
        assert cells[0] == pytest.approx(old, rel=5e-3)
        assert cells[2] == pytest.approx(new, abs=0.03)
    errors = CLOSURE["errors"]["hold_out"]
    for name, text in (("motion_nrmse", "motion"), ("relative_motion_nrmse", "relative motion")):
        old, new = (100 * errors[when][name] for when in ("before", "after"))
        assert f"{text} {old:.2f} to {new:.2f} %" in " ".join(PAGE.split())
