"""A closed loop in plain words: what was missing, how one knows, what changed, what remains."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import pytest

import discovery
from discovery.criteria.criteria import CRITERIA
from discovery.loop.result import Screened
from discovery.views.closure_file import closure_section
from discovery.views.closure_summary import lives_in, place_words, sections
from rom.effects import CATALOGUE
from rom.model.laws import Parameter
from tests.discovery.sound_closure import (
    LADDER,
    closure,
    force_map,
    friction,
    localisation,
    skew,
    threshold,
    unknown_force,
)


def said(found: discovery.loop.result.Closure) -> dict[str, str]:
    summary: dict[str, str] = closure_section(found)["summary"]
    return summary


def test_effects_are_named_with_place_equation_numbers_and_limits() -> None:
    text = closure(friction(), threshold()).summary()
    for part in (
        "What was missing: coulomb-friction in the link flexure_lo and loosening-threshold in the tension",
        "coulomb-friction: F = (F_c + mu * T) * tanh(v / v_s), with F_c = 0.1 N (95 %: 0.09 to 0.11)",
        "v_th = 0.025 m/s (95 %: 0.0225 to 0.0275)",
    ):
        assert part in text, part


def test_refitted_numbers_have_their_limits_in_digits_that_tell_them_apart() -> None:
    numbers = {
        "flexure_so.stiffness.k": Parameter(76499.97, "N/m", 76499.72, 76500.21),
        "joint.stiffness.beta": Parameter(0.0, "N", 0.0, 0.3, (0.0, 10.0)),
        "body.lo.mass": Parameter(8.6, "kg"),
    }
    found = replace(closure(friction()), refitted=numbers)
    assert said(found)["links"] == (
        "Refitted: flexure_so.stiffness.k = 76499.97 N/m (95 %: 76499.72 to 76500.21); "
        "joint.stiffness.beta = 0 N (at the end of its range; 95 %: at most 0.3); body.lo.mass = 8.6 kg."
    )
    rows = closure_section(found)["refitted"]
    assert rows[1] == {
        "name": "joint.stiffness.beta", "value": 0.0, "low": None, "high": 0.3, "unit": "N", "at_bound": True
    }  # fmt: skip
    assert "links" not in said(closure(friction()))


def test_limits_of_a_number_of_each_record_s_own_are_those_of_records() -> None:
    drift = CATALOGUE["tension-drift"].at("tension")
    drift = replace(drift, parameters={"d": replace(drift.parameters["d"], value=0.1, low=-0.1, high=0.3)})
    text = closure(replace(friction(), effect=drift)).summary()
    assert "d = 0.1 N/s (95 % of records: -0.1 to 0.3)" in text


def test_the_evidence_says_how_much_how_often_and_how_sure() -> None:
    lines = said(closure(friction(), threshold()))["evidence"].splitlines()
    first, second, rest = lines
    assert "explains 84 % of the residual" in first
    assert "improves 9 of 10 hold-out records" in first
    assert "p = 0.002" in first
    assert "p below 0.0001" in second  # a p of 0 is not claimed
    assert "acceleration-gain in the sensor acceleration_lo alone could explain most, 2 %" in rest


def test_look_alikes_come_with_the_test_that_separates_them() -> None:
    evidence = said(closure(friction()))["evidence"]
    words = (
        "Look-alikes, with their hold-out cost over that of coulomb-friction: quadratic-damping in the link"
    )
    assert f"{words} flexure_lo (1.07)" in evidence
    assert f"What would separate them: {LADDER}." in evidence
    (first, *_) = friction().look_alikes
    two = (first, replace(first, name="jenkins-slip", test="a hit of 9 N"))
    evidence = said(closure(replace(friction(), look_alikes=two)))["evidence"]
    assert f"What would separate it from quadratic-damping in the link flexure_lo: {LADDER}." in evidence
    assert "What would separate it from jenkins-slip in the link flexure_lo: a hit of 9 N." in evidence
    alone = replace(friction(), look_alikes=())
    assert "Look-alikes" not in closure(alone).summary()


def test_errors_are_those_of_records_that_no_fit_has_seen() -> None:
    found = closure(friction())
    changed = said(found)["changed"]
    before, after = (100 * (e["hold_out"]["motion_nrmse"] or 0.0) for e in (found.before, found.after))
    assert "no fit has seen" in changed
    assert f"the displacement from {before:.3g} to {after:.3g} %" in changed
    assert "none was held out" in said(closure(friction(), hold_out=0))["changed"]


def test_an_error_that_stays_is_not_called_a_change_and_noise_stands_beside_those_that_go() -> None:
    found = closure(friction())
    first, last = (dict(step.errors["hold_out"]) for step in (found.steps[0], found.steps[-1]))
    last["tension_rmse_n"] = first["tension_rmse_n"]
    steps = (*found.steps[:-1], replace(found.steps[-1], errors={**found.steps[-1].errors, "hold_out": last}))
    loss = "tension_loss_error_percent_median"
    floor = {
        "hold_out": {
            "motion_nrmse": 0.0111,
            "tension_rmse_n": 0.2,
            loss: 0.157,
            f"{loss}_with_variability": 20.7,
        }
    }
    changed = said(replace(found, steps=steps, noise_floor=floor))["changed"]  # type: ignore[arg-type]
    assert "% (noise alone: 1.11 %)" in changed
    assert "% (noise alone: 0.157 %, with the variability between tests: 20.7 %)" in changed
    assert f"Unchanged: the tension, {first['tension_rmse_n']:.3g} N (noise alone: 0.2 N)." in changed
    assert "the tension from" not in changed


def test_an_error_that_reads_the_same_before_and_after_is_unchanged() -> None:
    found = closure(friction())
    ends = [
        dict(step.errors["hold_out"]) | {"tension_rmse_n": error}
        for step, error in zip(found.steps, (1.1149, 1.1051), strict=True)
    ]
    steps = tuple(replace(step, errors={**step.errors, "hold_out": end})
                  for step, end in zip(found.steps, ends, strict=True))  # fmt: skip
    assert "Unchanged: the tension, 1.11 N." in said(replace(found, steps=steps))["changed"]  # type: ignore[arg-type]


def test_an_error_that_is_zero_before_and_after_is_unchanged() -> None:
    found = closure(friction())
    ends = [dict(step.errors["hold_out"]) | {"tension_rmse_n": 0.0} for step in found.steps]
    steps = tuple(replace(step, errors={**step.errors, "hold_out": end})
                  for step, end in zip(found.steps, ends, strict=True))  # fmt: skip
    assert "Unchanged: the tension, 0 N." in said(replace(found, steps=steps))["changed"]  # type: ignore[arg-type]


def test_no_effect_says_so_and_names_no_effect_as_found() -> None:
    found = closure(verdict="no-effect")
    parts = said(found)
    assert set(parts) == {"missing", "evidence", "remains", "excluded"}
    assert parts["missing"].startswith("What was missing: nothing that these records show")
    assert "of all candidates coulomb-friction" in parts["evidence"]
    assert "p = 0.4" in parts["remains"]


@pytest.mark.parametrize(
    ("effects", "what"), [((), "no effect of the catalogue"), ((unknown_force(),), "a term")]
)
def test_unexplained_says_where_the_rest_lives(
    effects: tuple[discovery.loop.result.FoundEffect, ...], what: str
) -> None:
    parts = said(closure(*effects, verdict="unexplained"))
    assert what in parts["missing"]
    assert "is more than noise" in parts["remains"]
    for place in ("channel acceleration_lo (6.92 times noise)", "frequency 5-40 Hz", "preload above 300 N"):
        assert place in parts["remains"]


def test_courses_of_the_tension_are_said_before_and_after_and_once_where_they_stay() -> None:
    left = [
        replace(localisation(1.1, 0.3), numbers=(("tension_courses", level),)) for level in (2.0, 1.01, 1.0)
    ]
    for before, words in ((left[0], "2 before and 1 times that of noise"), (left[1], "square 1 times that")):
        found = replace(closure(friction()), residual_before=before, residual_after=left[2])
        assert words in said(found)["remains"]


def test_regular_remains_are_not_called_noise() -> None:
    found = replace(closure(friction()), residual_after=localisation(1.1, 1e-6))
    assert "no more dependence than noise" not in found.summary()
    assert "shows more dependence than noise would (p below 0.0001)" in found.summary()


def test_a_view_without_a_peak_is_not_named() -> None:
    assert list(lives_in(localisation(1.0, 0.5).as_dict(), CRITERIA.localisation)) == []
    flat = replace(localisation(9.0, 0.0), by_test=(("coupled", 9.0), ("loosening", 9.1)))
    assert not any("kind of test" in place for place in lives_in(flat.as_dict(), CRITERIA.localisation))
    assert len(list(lives_in(flat.as_dict(), CRITERIA.localisation))) == 4


def test_a_fault_of_a_sensor_is_no_force() -> None:
    assert "fault is taken out of the records" in closure(skew()).summary()
    assert "fault" not in closure(friction()).summary()


def test_what_is_not_known_is_not_said() -> None:
    found = replace(closure(unknown_force(), hold_out=0), screened=(Screened("x", "joint", 0.0, 0.0),))
    text = found.summary()
    assert "nan" not in text
    assert "None" not in text
    assert "hold-out records" not in text
    assert "less than 0.1 %" in text
    assert "a_2 = -40 N s m^-1." in text  # without limits


@pytest.mark.parametrize(
    ("enters", "words"),
    [
        ("joint", "link joint"),
        ("body:so", "body so"),
        ("tension", "tension"),
        ("sensor:force_lo", "sensor force_lo"),
        (None, ""),
    ],
)
def test_places_in_words(enters: str | None, words: str) -> None:
    assert place_words(enters) == words


def test_the_figure_shows_every_view_before_and_after() -> None:
    found = closure(friction())
    axes = found.plot().axes
    assert [ax.get_title() for ax in axes][:2] == ["Channel", "Kind of test"]
    assert len(axes) == 5
    lines = {line.get_label(): list(line.get_xdata()) for line in axes[0].get_lines()}
    before, after = lines["Before"], lines["After"]
    assert before == [value for _, value in found.residual_before.by_channel]
    assert after == [value for _, value in found.residual_after.by_channel]


def test_the_views_of_time_harmonic_place_and_sign_are_said_and_drawn() -> None:
    after = replace(
        localisation(4.7, 1e-9),
        by_time=(("0 to 0.1 s", 9.0), ("0.1 to 0.35 s", 1.0)),
        by_harmonic=(("1st harmonic", 2.0), ("3rd harmonic", 7.0)),
        by_place=(("joint", 2.0), ("body so", 6.0)),
        by_sign=(("positive", 5.0), ("negative", 1.0)),
        repeats=(("repeatability", 0.9), ("repeatability_chance", 0.02), ("repeatability_pairs", 3.0)),
        forces=(force_map("joint"), replace(force_map("body so"), explained=0.05)),
        courses={"tension_by_preload": (("0 to 30 N", 4.0), ("30 to 100 N", 1.0))},
    )
    found = replace(closure(friction(), verdict="unexplained"), residual_before=after, residual_after=after)
    remains = said(found)["remains"]
    for part in (
        "after the impact 0 to 0.1 s (9 times noise)",
        "; 3rd harmonic (7 times noise)",
        "as a force, body so (6 times noise)",
        "displacement positive (5 times noise)",
        "courses of the tension at 0 to 30 N (4 times noise)",
        "As a force on the link joint 80 % of it is one function of displacement and velocity, odd in "
        "velocity by 90 %; 10 % is memory",
        "correlate by 0.9 (noise: 0.02)",
    ):
        assert part in remains, part
    figure = found.plot()
    titles = [ax.get_title() for ax in figure.axes]
    assert titles[5:9] == ["Time since the impact", "Harmonic", "As a force", "Displacement"]
    assert titles[9] == "Tension's courses by preload"
    maps = titles.index("Before, joint")
    assert titles[maps : maps + 2] == ["Before, joint", "After, joint"]
    assert "First cycles" in titles[maps:]
    first, second = (figure.axes[place].collections[0] for place in (maps, maps + 1))
    assert first.get_clim() == second.get_clim()
    figure.draw_without_rendering()


def test_a_force_that_noise_explains_is_not_said_to_be_a_function() -> None:
    chance = replace(force_map("joint"), explained_p=0.3)
    after = replace(localisation(4.7, 1e-9), forces=(chance,))
    found = replace(closure(friction(), verdict="unexplained"), residual_after=after)
    assert "As a force on" not in found.summary()


def test_what_a_campaign_does_not_have_is_not_in_its_file() -> None:
    plain = localisation(2.0, 0.5).as_dict()
    assert not {"by_time", "by_harmonic", "by_place", "by_sign", "forces", "repeatability"} & set(plain)
    more = replace(localisation(2.0, 0.5), forces=(force_map("joint"),), repeats=(("repeatability", 0.5),))
    assert json.loads(json.dumps(more.as_dict(), allow_nan=False))["forces"][0]["force_n"][0][0] is None
    assert list(more.as_dict())[: len(plain)] == list(plain)


def test_a_residual_without_views_still_has_a_figure() -> None:
    empty = replace(
        localisation(1.0, 0.5),
        **dict.fromkeys(("by_channel", "by_test", "by_frequency", "by_preload", "by_amplitude"), ()),
    )
    found = replace(closure(friction()), residual_before=empty, residual_after=empty)
    assert found.plot().axes == []
    assert "What remains" in found.summary()


def test_a_closure_prints_short() -> None:
    found = closure(friction(), threshold())
    named = "coulomb-friction in flexure_lo, loosening-threshold in tension"
    assert repr(found) == f"Closure('closed', effects: {named})"
    assert repr(closure(verdict="no-effect")) == "Closure('no-effect', effects: none)"


def test_errors_of_every_step_as_a_frame() -> None:
    frame = closure(friction(), threshold()).to_frame()
    assert list(frame["model"]) == [
        name for name in ("declared", "coulomb-friction", "loosening-threshold") for _ in "ab"
    ]
    assert (
        frame["motion_nrmse"].is_monotonic_decreasing
        or frame["motion_nrmse"].iloc[-1] < frame["motion_nrmse"].iloc[0]
    )


def test_closed_loops_are_imported_when_they_are_used() -> None:
    assert discovery.Closure is discovery.loop.result.Closure
    assert {"close_loop", "discover", "Closure"} <= set(dir(discovery))
    with pytest.raises(AttributeError, match="close_lop"):
        discovery.close_lop  # noqa: B018 - the access is what is tested
    heavy = ("discovery.loop.result", "matplotlib")
    code = f"import sys, discovery; print([m for m in sys.modules if m in {heavy}])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_no_effect_says_what_is_excluded_and_what_may_be_there() -> None:
    first, second, third = said(closure(verdict="no-effect"))["excluded"].splitlines()
    assert first == (
        "What is excluded: with probability 0.8 these records would have shown "
        "cubic-stiffness in the link flexure_lo from k3 = 1.4e+08 N/m3; and 1 more."
    )
    assert "Not excluded" in second
    assert "even-stiffness in the link flexure_so from k2 = 1.3e+06 N/m2" in second
    assert "constant-force in the body lo" in second
    assert third == "Strengths of which no limit is known: 1; closure.json says why of each."


def test_nothing_is_said_to_be_excluded_where_more_than_noise_is_left() -> None:
    assert "excluded" not in said(closure(verdict="unexplained"))


def test_a_closure_states_the_numbers_of_its_criteria() -> None:
    used = CRITERIA.changed(detection={"probability": 0.6})
    section = closure_section(replace(closure(), criteria=used))
    assert section["criteria"] == {"detection": {"probability": 0.6}}
    assert "criteria" not in closure_section(closure())
    limit = {"name": "hum", "enters": "joint", "parameter": "A", "unit": "N", "value": 1.0,
             "share_of_default": 0.5, "reason": None}  # fmt: skip
    told = sections(section | {"verdict": "no-effect", "detection_limits": [limit]})["excluded"]
    assert "with probability 0.6 these records" in told
