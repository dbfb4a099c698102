"""Which test would tell two effects apart that the records at hand cannot.

For effects A and B and a test that could be made, the outputs of both are taken along the motion that the
refined model (A in it) would have there; what the numbers of the model with B in A's place can imitate, over
the records at hand and that test together, is taken off. What is then left of the difference, beyond what was
left before, is by how much the test would raise the cost of B over that of A. A test tells the two apart
where that is beyond chance and more than a slightly wrong form of A might lose there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from discovery.criteria.separating import Separating
from discovery.explain.effect_outputs import output_of, slopes_of
from discovery.explain.motion import free_numbers
from discovery.explain.motion_fit import with_effects
from discovery.residual.free_parameters import effect_number, size_of
from discovery.residual.output_error import WhitenedResidual, whiten
from discovery.residual.trajectory import MeasuredTrajectory
from discovery.separating_tests.normal_sums import NormalSums
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import CATALOGUE, ModelCorrection
from rom.evaluation.replay import replay
from rom.identification.spectral_model import ComplexArray, SpectralRecord

# of a record's force, and of repeats, beside the most allowed
_FACTORS: Numerical[tuple[float, ...]] = (1.0, 2.0)
_REPEATS: Numerical[tuple[int, ...]] = (1, 3)


@dataclass(frozen=True, eq=False)
class _Test:
    """A test in words, how much harder than one at hand it is, and the motion of the model in it."""

    words: str
    harder: float
    trace: MeasuredTrajectory


@dataclass(frozen=True, eq=False)
class _Along:
    """Records, and the output of the best effect along them, (rows,)."""

    residual: WhitenedResidual
    output: FloatArray

    @classmethod
    def of(cls, residual: WhitenedResidual, best: ModelCorrection) -> _Along:
        return cls(residual, output_of(best, residual))


def separating_tests(
    best: ModelCorrection,
    rivals: Sequence[ModelCorrection],
    residual: WhitenedResidual,
) -> list[str]:
    """Return for every rival the test, in words, that would tell it from the best effect.

    Of the tests that would, one that need be repeated least, then the mildest, then the one that tells most.

    Parameters
    ----------
    best : ModelCorrection
        The effect in the model of the residual.
    rivals : sequence of ModelCorrection
        With their fitted numbers.
    residual : WhitenedResidual
        The refined model on the records at hand.

    Returns
    -------
    list of str
        Empty for effects that do not act on the motion.
    """
    rules, apart = residual.criteria.separating, residual.criteria.acceptance
    in_motion = [one.kind in ("force", "sensor fault") for one in (best, *rivals)]
    if not in_motion[0] or not any(in_motion[1:]):
        return [""] * len(rivals)
    tests = list(_tests(residual, rules))
    if not tests:
        return [""] * len(rivals)
    traces = [test.trace for test in tests]
    traced = with_effects(whiten(traces, residual.baseline, residual.floors, residual.criteria))
    here, there = _Along.of(residual.of_training(), best), _Along.of(traced, best)
    repeats = _repeats(rules)
    whole = _gains(best, None, here, there, repeats)
    needed = np.maximum(apart.indistinguishable_cost, apart.indistinguishable_share * whole)
    return [
        _words(_gains(best, rival, here, there, repeats), tests, needed, repeats, rules) if moves else ""
        for rival, moves in zip(rivals, in_motion[1:], strict=True)
    ]


def _repeats(rules: Separating) -> list[int]:
    most = int(rules.effect_repeats)
    return [*(times for times in _REPEATS if times < most), most]


def _tests(residual: WhitenedResidual, rules: Separating) -> Iterator[_Test]:
    """Tests like those at hand, with harder hits, from the other side and on the other bodies too."""
    sizes = [*(size for size in _FACTORS if size < rules.effect_hardest), rules.effect_hardest]
    factors = [side * size for size in sizes for side in (1, -1)]  # below 0: from the other side
    masses = {body.name: body.mass for body in residual.baseline.model.structure.bodies}
    for trace in _at_hand(residual.of_training().traces, int(rules.effect_preloads)):
        alone = trace.measurement.test == "uncoupled"
        where = "alone, bolt out," if alone else f"at {_digits(trace.level)} N of tension"
        struck, peak = _hit(trace)
        for body, factor in product(trace.bodies, factors):
            times = factor * masses[body] / masses[struck]  # as fast a motion of either body
            imagined = _imagined(trace, residual, body, times)
            if imagined is not None:
                side = "" if factor > 0 else " from the other side"
                yield _Test(
                    f"hit {body} {where} with {_digits(abs(times) * peak)} N{side}", abs(factor), imagined
                )


def _at_hand(traces: Iterable[MeasuredTrajectory], preloads: int) -> Iterator[MeasuredTrajectory]:
    """A few records of each kind of hit, over all preloads."""
    alike: dict[tuple[str, str], list[MeasuredTrajectory]] = {}
    for trace in traces:
        if trace.measurement.impact_s is not None and trace.measurement.force:
            kind = "uncoupled" if trace.measurement.test == "uncoupled" else "bolted"
            alike.setdefault((_hit(trace)[0], kind), []).append(trace)
    for ones in alike.values():
        ordered = sorted(ones, key=lambda trace: trace.level)
        yield from (ordered[i] for i in np.unique(np.linspace(0, len(ordered) - 1, preloads).astype(int)))


def _hit(trace: MeasuredTrajectory) -> tuple[str, float]:
    """The body that was struck, and the peak force [N]."""
    peaks = {body: float(np.abs(force).max()) for body, force in trace.measurement.force.items()}
    return max(peaks.items(), key=lambda one: one[1])


def _imagined(
    trace: MeasuredTrajectory, residual: WhitenedResidual, body: str, times: float
) -> MeasuredTrajectory | None:
    """The record as the model has it, its force on a body and multiplied; None where the model diverges."""
    seen, (struck, _) = trace.in_double_precision(), _hit(trace)
    hit = replace(seen, force={body: times * seen.force[struck]})
    response = replay(residual.baseline.model, hit).response
    if response.status != "ok":
        return None
    motion = {
        body: replace(one, samples=getattr(response, one.kind)[body]) for body, one in seen.motion.items()
    }
    tension = response.tension if isinstance(response.tension, np.ndarray) else np.zeros(0)
    kept = slice(trace.parts[0].samples[0] % trace.stride, None, trace.stride)
    here, there = trace.bodies.index(struck), trace.bodies.index(body)
    return replace(
        trace,
        measurement=replace(hit, motion=motion),
        parts=tuple(_struck(part, here, there, times) for part in trace.parts),
        displacement={body: response.displacement[body][kept] for body in trace.bodies},
        velocity={body: response.velocity[body][kept] for body in trace.bodies},
        tension=tension[kept] if tension.size else trace.tension,
    )


def _struck(part: SpectralRecord, here: int, there: int, times: float) -> SpectralRecord:
    """Spectra of a force that goes from one body to another and is multiplied; the hammer's noise stays."""

    def relocated(columns: ComplexArray) -> ComplexArray:
        out = np.zeros_like(columns)
        out[:, there] = columns[:, here]
        return out

    errors = None if part.force_errors is None else relocated(part.force_errors)
    return replace(part, force=times * relocated(part.force), force_errors=errors, motion=times * part.motion)


def _gains(
    best: ModelCorrection,
    rival: ModelCorrection | None,
    at_hand: _Along,
    tests: _Along,
    numbers: Sequence[int],
) -> FloatArray:
    """By how much tests raise the cost of the rival, or of no effect, over the best's, (tests, repeats).

    The model with the rival has not the best one's numbers: free, they would imitate that one's whole force.
    What a test adds beyond its own difference comes from numbers that it holds, by which records at hand tell
    the two apart: that may rest on what the model has a little wrong, and does not count for a rival.
    """
    gone = {effect_number(best, name) for name in best.parameters}
    names = [name for name in at_hand.residual.names if name not in gone]
    here = _normals(rival, at_hand, names)
    now = sum(here[1:], here[0])
    left = now.remainder()
    every = _normals(rival, tests, names)
    most = [np.inf if rival is None else one.cost for one in every]
    return np.array(
        [
            [min((now + one.repeated(n)).remainder() - left, n * own) for n in numbers]
            for one, own in zip(every, most, strict=True)
        ]
    )


def _normals(rival: ModelCorrection | None, along: _Along, names: Sequence[str]) -> list[NormalSums]:
    """The sums of every record."""
    residual = along.residual
    place = {name: k for k, name in enumerate(residual.names)}
    none = np.zeros(len(residual.residual))
    columns = np.column_stack(
        [residual.jacobian[:, place[name]] if name in place else none for name in names]
    )
    difference = -along.output
    if rival is not None:
        free = free_numbers(rival, CATALOGUE[rival.name])
        sizes = np.array([size_of(rival.parameters[name].value) for name in free])
        columns = np.column_stack([columns, slopes_of(rival, free, sizes, residual)])
        difference = difference + output_of(rival, residual)
    found = []
    for record in range(len(residual.traces)):
        rows = residual.owner == record
        mine, d = columns[rows], difference[rows]
        found.append(NormalSums(mine.T @ mine, mine.T @ d, float(d @ d)))
    return found


def _words(
    gains: FloatArray,
    tests: Sequence[_Test],
    needed: FloatArray,
    numbers: Sequence[int],
    rules: Separating,
) -> str:
    for times, *columns in zip(numbers, gains.T, needed.T, strict=True):
        telling = [one for one in zip(tests, *columns, strict=True) if one[1] >= one[2]]
        if telling:
            test, gain, enough = max(telling, key=lambda one: (-one[0].harder, one[1] / one[2]))
            repeats = f", {times} times" if times > 1 else ""
            expected = f"a difference in chi-square of {_digits(gain)} is expected"
            return f"{test.words}{repeats}: {expected}, {_digits(enough)} is enough"
    none = f"none of {len(tests)} hits tried, up to {rules.effect_hardest:g} times as hard as those at hand"
    nearest = int(np.argmax(gains[:, 0] / needed[:, 0]))
    gain, enough = gains[nearest, 0], needed[nearest, 0]
    return (
        none
        if gain < rules.least_gain
        else f"{none}; nearest: {tests[nearest].words}, with an expected difference in chi-square of "
        f"{_digits(gain)}, where {_digits(enough)} is enough"
    )


def _digits(value: float) -> str:
    """Three digits, without a power of ten below a million."""
    return f"{float(f'{value:.3g}'):.6g}"
