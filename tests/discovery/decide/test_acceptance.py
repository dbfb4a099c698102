"""What makes an explanation sure, alike another, or harmful."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import pytest

from benchmarks.false_alarms import null_of, rows
from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.decide.acceptance import (
    OVER_NOISE,
    MaterialErrors,
    at_noise_floor,
    harms,
    is_accepted,
    is_exact,
    is_indistinguishable,
    is_material,
    is_significant,
    motion_errors,
)
from discovery.decide.explanation import Explanation
from rom.effects import CATALOGUE
from rom.evaluation.error_measures import ErrorsByKind


def explained(
    training: float, held_out: float, *, place: str = "tension", left: float | None = None
) -> Explanation:
    """An effect that takes so much from the cost of 200 training and 50 held-out numbers."""
    name = "relaxation-log" if place == "tension" else "cubic-stiffness"
    return Explanation(
        CATALOGUE[name].at(place),
        {"t.h5": 400.0, "h.h5": 100.0},
        {"t.h5": 400.0 - training, "h.h5": 100.0 - held_out},
        {"t.h5": 200, "h.h5": 50},
        frozenset({"h.h5"}),
        2,
        left=left,
    )


def errors(tension: float | None, motion: float, training: float = 1.0, failed: int = 0) -> ErrorsByKind:
    """Of one record in five that is held out, and of the others."""
    of_training = {"tension_rmse_n": training, "motion_nrmse": 0.02, "records": 4, "failed": 0}
    held_out = {"tension_rmse_n": tension, "motion_nrmse": motion, "records": 1, "failed": failed}
    return cast(ErrorsByKind, {"hold_out": held_out, "training": of_training})


def test_an_effect_of_the_tension_is_sure_beyond_chance_and_on_tests_unseen() -> None:
    assert is_accepted(explained(30.0, 5.0, left=1.0))
    assert not is_accepted(explained(15.0, 5.0, left=1.0))
    assert not is_accepted(explained(30.0, -1.0, left=1.0))


@pytest.mark.parametrize(
    ("gains", "place", "sure"),
    [
        ((90.0, 90.0, -1.0, -1.0), "joint", True),
        ((180.0, -0.5, -0.5, -0.5), "joint", False),
        ((180.0, -0.5, -0.5, -0.5), "tension", True),  # few tests loosen much
    ],
)
def test_in_the_motion_a_few_records_do_not_outvote_the_others(
    gains: tuple[float, ...], place: str, sure: bool
) -> None:
    one, files = explained(300.0, 0.0, place=place, left=1.0), [f"h{i}.h5" for i in range(len(gains))]
    several = replace(
        one,
        before={"t.h5": 400.0} | dict.fromkeys(files, 200.0),
        after={"t.h5": 100.0} | {file: 200.0 - gain for file, gain in zip(files, gains, strict=True)},
        hold_out=frozenset(files),
    )
    assert is_accepted(several) is sure


def test_a_difference_in_the_motion_is_told_however_small_its_share() -> None:
    slight = replace(explained(200.0, 30.0, place="joint", left=1.0), before={"t.h5": 1e5, "h.h5": 1e4})
    slight = replace(slight, after={"t.h5": 1e5 - 200.0, "h.h5": 1e4 - 30.0})
    assert is_significant(slight)
    assert not is_accepted(slight)
    assert not is_significant(replace(slight, left=1.5))
    assert not is_significant(explained(100.0, 30.0, place="joint", left=1.0))
    assert not is_significant(explained(200.0, 10.0, place="joint", left=1.0))


def test_what_is_left_makes_a_gain_less_telling() -> None:
    assert not is_accepted(explained(30.0, 5.0, left=3.0))


def test_in_the_tension_training_tests_may_tell_two_effects_apart() -> None:
    best = explained(90.0, 10.0, left=1.0)
    assert is_indistinguishable(explained(85.0, 2.0, left=1.0), best)
    assert not is_indistinguishable(explained(20.0, 9.0, left=1.0), best)
    assert not is_indistinguishable(explained(89.0, -9.0, left=1.0), best)


def test_in_the_motion_unseen_records_tell_them_apart() -> None:
    best = explained(90.0, 40.0, place="joint")
    assert is_indistinguishable(explained(60.0, 35.0, place="joint"), best)
    assert not is_indistinguishable(explained(89.0, 9.0, place="joint"), best)


@pytest.mark.parametrize(
    ("after", "harm"),
    [
        (errors(1.2, 0.02), False),
        (errors(3.0, 0.02), False),  # one test in five, which scatter makes
        (errors(4.0, 0.02), True),
        (errors(1.6, 0.02, training=1.6), True),
        (errors(0.5, 0.08), True),
        (errors(None, 0.02), True),  # its simulations did not finish
        (errors(0.5, 0.02, failed=1), True),  # one of them
    ],
)
def test_an_effect_that_ruins_what_is_simulated_on_harms(after: ErrorsByKind, harm: bool) -> None:
    assert harms(errors(1.0, 0.02), after) is harm


def test_without_held_out_tests_training_tests_tell_of_harm() -> None:
    assert harms(errors(None, 0.02), errors(None, 0.02, training=2.0))


def test_noise_is_quiet_and_so_is_next_to_nothing_of_much() -> None:
    assert at_noise_floor(1.19, 1.0)
    assert not at_noise_floor(1.3, 5.0)
    assert at_noise_floor(1.3, 20.0)


SETTLED = CRITERIA.acceptance.material_error_explained


def motion(error: float, relative: float | None = None) -> MaterialErrors:
    shown = {"motion_nrmse": error, "relative_motion_nrmse": relative or 2 * error}
    return motion_errors(cast(ErrorsByKind, {"hold_out": shown, "training": shown}))


def test_an_effect_that_leaves_little_beyond_noise_need_not_lower_errors_but_must_not_raise_them() -> None:
    assert is_material(motion(1.0), motion(0.999), closes=True)
    assert not is_material(motion(1.0), motion(1.05), closes=True)
    assert not is_material(motion(1.0), motion(0.999), least=SETTLED, closes=True)


def test_an_error_of_a_few_records_may_rise_a_little_where_little_beyond_noise_is_left() -> None:
    assert is_material(motion(1.0), motion(1.0, 2 * 1.12), closes=True)
    assert not is_material(motion(1.0), motion(1.0, 2 * 1.3), closes=True)
    assert not is_material(motion(1.0), motion(1.0, 2 * 1.12))


@pytest.mark.parametrize(
    ("error", "relative", "accepted"),
    [(1.01, 2.01, True), (1.1, 2.01, False), (1.1, 1.99, True), (1.3, 1.99, False)],
)
def test_what_is_measured_may_gain_but_no_displacement_is_met_much_worse_unless_another_is_met_better(
    error: float, relative: float, accepted: bool
) -> None:
    before = {**motion(1.0)[0], OVER_NOISE: 1.0}
    after = {**motion(error, relative)[0], OVER_NOISE: 0.9}
    assert is_material([before], [after], closes=True) is accepted


def test_an_effect_that_follows_a_strong_one_must_lower_an_error_by_more() -> None:
    assert is_material(motion(1.0), motion(0.95))
    assert not is_material(motion(1.0), motion(0.99))
    assert not is_material(motion(1.0), motion(0.95), least=SETTLED)
    assert is_material(motion(1.0), motion(0.8), least=SETTLED)


def test_the_largest_gain_by_chance_is_told_by_its_training_records() -> None:
    fits = [explained(*gains, left=1.0) for gains in ((3.0, 9.0), (30.0, 5.0), (15.0, 2.0))]
    found = null_of(fits)
    assert (found.effects, found.training, found.hold_out, found.sure) == (3, 30.0, 5.0, 1)
    quiet = null_of(fits[::2])
    table = list(rows(2.0, [(quiet, found), (quiet, quiet)]))
    assert [(row[:4], row[-1]) for row in table] == [
        (("2", "motion", "2", "2"), "0"),
        (("2", "tension", "2", "2"), "1"),
    ]
    assert table[1][4] == "22.5"


@pytest.mark.parametrize(
    ("motion_nrmse", "relative", "held_out", "failed", "exact"),
    [
        (0.003, 0.01, 0.003, 0, True),
        (0.003, None, None, 0, True),
        (0.02, 0.01, 0.003, 0, False),
        (0.003, 0.05, 0.003, 0, False),
        (0.003, 0.01, 0.02, 0, False),
        (0.003, 0.01, 0.003, 1, False),
        (None, None, None, 0, False),
    ],
)
def test_a_motion_within_what_samples_tell_of_a_hit_is_exact(
    motion_nrmse: float | None, relative: float | None, held_out: float | None, failed: int, exact: bool
) -> None:
    told = {"motion_nrmse": motion_nrmse, "relative_motion_nrmse": relative, "records": 5, "failed": failed}
    unseen = {**told, "motion_nrmse": held_out, "records": 2}
    assert is_exact(cast(ErrorsByKind, {"training": told, "hold_out": unseen})) is exact


def test_criteria_that_are_handed_over_decide() -> None:
    one = explained(30.0, 5.0, left=1.0)
    strict = Criteria().changed(
        acceptance={"training_gain_tension": 31.0, "material_error": 0.2, "harm": 1.1}
    )
    assert is_accepted(one)
    assert not is_accepted(one, strict)
    assert is_material(motion(1.0), motion(0.9))
    assert not is_material(motion(1.0), motion(0.9), criteria=strict)
    assert not harms(errors(1.0, 0.02), errors(1.0, 0.02, training=1.3))
    assert harms(errors(1.0, 0.02), errors(1.0, 0.02, training=1.3), strict)
    near = Criteria().changed(acceptance={"indistinguishable_cost": 0.0, "indistinguishable_share": 0.0})
    best, rival = explained(90.0, 10.0, left=1.0), explained(85.0, 9.0, left=1.0)
    assert is_indistinguishable(rival, best)
    assert not is_indistinguishable(rival, best, near)
    assert at_noise_floor(1.19, 1.0)
    assert not at_noise_floor(1.19, 1.0, Criteria().changed(acceptance={"noise_level": 1.1}))


def test_errors_are_compared_on_records_of_one_kind() -> None:
    def of(held_out: float | None, training: float) -> MaterialErrors:
        kinds = {"hold_out": held_out, "training": training}
        shown = {kind: {"motion_nrmse": e, "relative_motion_nrmse": e} for kind, e in kinds.items()}
        return motion_errors(cast(ErrorsByKind, shown))

    assert is_material(of(1.0, 0.5), of(0.9, 0.6))
    assert not is_material(of(1.0, 0.5), of(None, 0.4))  # no hold-out record can be simulated any more
    assert is_material(of(None, 0.5), of(0.9, 0.4))  # none could before: training records tell
