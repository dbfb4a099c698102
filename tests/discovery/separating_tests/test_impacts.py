from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rom
from discovery.courses.fit import at_fit, deviation_of_bolt, log_predictive, refine
from discovery.courses.frozen_motion import freeze, freeze_bolts
from discovery.criteria.criteria import CRITERIA
from discovery.laws.candidate import Candidate, Term, baseline, constant_power, no_loosening
from discovery.laws.factors import tension_power, velocity_power
from discovery.separating_tests.impacts import Proposal, _grid, _response, _way, propose_tests
from tests.discovery.bolts import bolts_of
from tests.discovery.synthetic import RATE_HZ, free_power, known_fit, measured, model_with, small, with_power


def held(n: float) -> Candidate:
    term = Term(velocity_power().held(n=n), baseline().terms[0].tension)
    return Candidate(f"power {n:g}", (term,), (1e11,))


def test_rivals_get_a_test_within_reach() -> None:
    whole = small()
    fits = [refine(law, whole) for law in (baseline(), held(3.0), constant_power(4.0, "quartic"))]
    found = propose_tests(fits, whole)
    strongest = max(course.force.max() for course in whole.courses)
    assert 1 <= len(found) <= 3
    assert found[-1].odds >= 100
    for test in found:
        assert test.body == "lo"
        assert 0 < test.peak_force <= 1.5 * strongest
        assert whole.initial.min() / 1.6 < test.preload < whole.initial.max() * 1.6
        assert 2e-4 < test.pulse_length < 2e-3
        assert test.hits >= 1
        assert set(test.laws) <= {one.candidate.name for one in fits}
        assert test.expected_gain >= 0
        assert f"{test.peak_force:.3g} N" in test.summary
        assert "odds of" in test.summary
    assert np.all(np.diff([test.odds for test in found]) >= 0)


def test_the_proposed_test_separates_as_much_as_expected() -> None:
    """Made on simulated courses it brings evidence, and more than the campaign's own weakest kind of hit."""
    few = freeze(rom.paper_model(), measured(preloads=(60.0, 300.0, 1500.0), scatter=0.3, noise=2.0, seed=3))
    fits = [refine(law, few) for law in (held(4.0), held(3.0))]
    (test, *_) = propose_tests(fits, few)
    gained = []
    for peak, preload in ((test.peak_force, test.preload), (0.3 * 1608.7, 3000.0)):
        again = measured(
            fits[0].candidate,
            preloads=[preload] * 6,
            strengths=(peak / 1608.7,),
            noise=2.0,
            scatter=0.3,
            seed=4,
        )
        whole = freeze(rom.paper_model(), again)
        gained.append(float((log_predictive(fits[0], whole) - log_predictive(fits[1], whole)).mean()))
    assert gained[0] > 10 * abs(gained[1])
    assert gained[0] > 0.5


def test_what_hits_are_expected_to_add_makes_up_the_odds() -> None:
    whole = replace(small(), criteria=CRITERIA.changed(separating={"odds": 1e4}))
    found = propose_tests([known_fit(law, whole) for law in (baseline(), held(3.0))], whole)
    gained = sum(test.hits * test.expected_gain for test in found)
    assert gained == pytest.approx(2 * np.log(found[-1].odds))


def test_no_hit_is_proposed_that_takes_half_of_the_tension() -> None:
    """Where most is lost the rival's refit absorbs nearly all that its linear change could not."""
    whole = small(noise=20.0)
    fits = [known_fit(law, whole) for law in (held(4.0), held(4.4))]
    found = propose_tests(fits, whole)
    assert found
    for test in found:
        for one in fits:
            model = model_with(one.candidate)
            assert tension_left(model, test) > 0.45 * test.preload  # not simulated at the same rate


def tension_left(model: rom.Model, test: Proposal) -> float:
    time = np.arange(round(0.6 * RATE_HZ)) / RATE_HZ
    pulse = np.where(time < test.pulse_length, np.sin(np.pi * time / test.pulse_length), 0.0)
    response = model.simulate({"lo": test.peak_force * pulse}, RATE_HZ, test.preload)
    return float(np.asarray(response.tension)[-1])


def test_of_several_bolts_the_one_is_named_on_which_the_test_tells_most() -> None:
    """The first loses next to nothing, whatever is done to it."""
    both = freeze_bolts(bolts_of(with_power(4.0), (-8.0, 0.0), scatter=0.2, noise=5.0))
    fits = [refine(law, both) for law in (held(4.0), held(3.5))]
    found = propose_tests(fits, both, bolts=("quiet", "loose"))
    assert found
    assert {test.bolt for test in found} == {"loose"}
    assert all(f"at a preload of {test.preload:.3g} N of loose: separates" in test.summary for test in found)
    assert propose_tests(fits, both)[0].bolt == "bolt 2"


def test_a_new_bolt_never_tells_more_than_one_tested_at_the_same_rate() -> None:
    """All of the variance between bolts is unknown of it, and what is unknown counts for the rival law."""
    both = freeze_bolts(bolts_of(with_power(4.0), (-0.5, 0.5), scatter=0.2, noise=5.0))
    fits = [known_fit(law, both) for law in (held(4.0), held(3.5))]
    grid = _grid(both)
    _, cases = next(both.by_bolt())
    tested = [deviation_of_bolt(one, at_fit(one, both)[1], both.initial, cases) for one in fits]
    assert all(error < one.sigma for (_, error), one in zip(tested, fits, strict=True))
    new = [(rate, one.sigma) for (rate, _), one in zip(tested, fits, strict=True)]
    known, unknown = (
        _way(*(_response(one, *rate, both, grid) for one, rate in zip(fits, rates, strict=True)), both, grid)
        for rates in (tested, new)
    )
    for hits in (1, 10):
        more = unknown.of_each(hits) - known.of_each(hits)
        assert more.max() <= 1e-9
        assert more.min() < -0.1


def test_more_noise_promises_less() -> None:
    gains = []
    for noise in (1.0, 30.0):
        whole = freeze(rom.paper_model(), measured(preloads=(60.0, 300.0), scatter=0.3, noise=noise, seed=1))
        tests = propose_tests([known_fit(law, whole) for law in (held(4.0), held(3.5))], whole, most_tests=1)
        gains.append(sum(test.expected_gain for test in tests))
    assert gains[1] < 0.5 * gains[0]


def test_no_more_kinds_of_tests_than_asked_for() -> None:
    whole = small()
    law = Candidate("r", (Term(velocity_power(), tension_power(0.7, free=True)),), (1e9,))
    fits = [known_fit(candidate, whole) for candidate in (free_power(), law, held(3.0))]
    assert len(propose_tests(fits, whole, most_tests=1)) == 1


def test_laws_that_agree_everywhere_get_none() -> None:
    whole = small()
    same = known_fit(baseline(), whole)
    assert propose_tests([same, same], whole) == ()


def test_one_law_or_none_that_loosens_gets_none() -> None:
    whole = small()
    assert propose_tests([known_fit(baseline(), whole)], whole) == ()
    assert propose_tests([known_fit(baseline(), whole), known_fit(no_loosening(), whole)], whole) == ()
