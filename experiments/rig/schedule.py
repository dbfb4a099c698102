"""Which tests are run: preloads, hits, and how this bolt scatters from test to test."""

from dataclasses import dataclass, replace

import numpy as np

from experiments.rig.excitation import FloatArray, Hit, contact_time

FULL_SCALE_PRELOADS = 58
FULL_SCALE_TIGHTENING = 26
IMPACT_TIME = 0.5
HAMMER_MEAN, HAMMER_DEVIATION = 1608.7, 81.65
LOW_MEAN, LOW_DEVIATION = 30.5, 3.5
"""Low impacts [N]: the paper prints 26.9, 29.1 and 40 N, and a mean loss that belongs to about 30 N."""


@dataclass(frozen=True)
class Case:
    """One test as it truly is.

    Attributes
    ----------
    file, test : str
        Path in the campaign folder and kind of test.
    hit : Hit
        The blow.
    preload : float or None
        Nominal tension [N] as the operator notes it; None without the bolt.
    tension : float
        True tension before the impact [N].
    gamma_factor : float
        Factor of this test on gamma(T); negative tightens.
    hold_out : bool
        Kept back from every fit.
    """

    file: str
    test: str
    hit: Hit
    preload: float | None = None
    tension: float = 0.0
    gamma_factor: float = 1.0
    hold_out: bool = False


def preloads(cases: int | None, rng: np.random.Generator) -> FloatArray:
    """Return nominal preloads [N]: evenly spaced in the logarithm, or the paper's 58 with an uneven hand.

    Of the paper's only range (5.8 to 3013 N) and density (most below 1000 N) are known.
    """
    if cases is not None:
        return np.round(np.geomspace(6.0, 3000.0, cases), 1)
    place = np.arange(FULL_SCALE_PRELOADS, dtype=np.float64)
    place[1:-1] += rng.uniform(-0.4, 0.4, FULL_SCALE_PRELOADS - 2)
    spaced: FloatArray = 5.8 * (3013.0 / 5.8) ** (place / place[-1])
    return np.round(spaced, 1)


def gamma_deviation(tension: float) -> float:
    """Return the standard deviation of log10 gamma from test to test at a tension [N].

    It falls from 0.33 to 0.05 about the 850 N above which the paper's losses repeat: a compromise between the
    paper's scatter of gamma (R^2 0.94) and of final tensions (mean error 3.66 %, median 1.15 %).
    """
    return 0.05 + 0.28 / (1.0 + float(np.exp((tension - 850.0) / 100.0)))


def gamma_factor(tension: float, scatter: float, rng: np.random.Generator) -> float:
    """Draw a test's factor on gamma: lognormal, cut at 1.5 deviations: no test emptied its bolt.

    Parameters
    ----------
    tension : float
        Preload [N].
    scatter : float
        Factor on `gamma_deviation`.
    rng : numpy.random.Generator
        Source of the draw.

    Returns
    -------
    float
        Positive.
    """
    normal = float(np.clip(rng.standard_normal(), -1.5, 1.5))
    return float(10.0 ** (scatter * gamma_deviation(tension) * normal))


def tightening_cases(nominal: FloatArray, count: int, rng: np.random.Generator) -> list[int]:
    """Draw the preloads at which a test tightened and had to be repeated: below 1100 N, rarer the tighter.

    Parameters
    ----------
    nominal : ndarray, shape (preloads,)
        Preloads [N].
    count : int
        Draws; a preload may be drawn again.
    rng : numpy.random.Generator
        Source of the draws.

    Returns
    -------
    list of int
        Places of the preloads, in order.
    """
    weight = np.where(nominal < 1100.0, np.exp(-nominal / 500.0), 0.0)
    if count == 0 or not weight.any():
        return []
    return sorted(int(index) for index in rng.choice(nominal.size, count, p=weight / weight.sum()))


def hammer(body: str, strength: float, rng: np.random.Generator) -> Hit:
    """Return a blow with trigger jitter (2 ms) and a contact time that varies by 2 %.

    Parameters
    ----------
    body : str
        ``"lo"`` or ``"so"``.
    strength : float
        Peak force [N].
    rng : numpy.random.Generator
        Source of jitter and contact time.

    Returns
    -------
    Hit
        About `IMPACT_TIME`.
    """
    start = IMPACT_TIME + rng.uniform(-0.002, 0.002)
    return Hit(body, strength, start, contact_time(strength) * np.exp(0.02 * rng.standard_normal()))


def held_out(index: int, count: int, every: int) -> bool:
    """Whether a preload's records are kept back: one in `every`, never the lowest or highest.

    Parameters
    ----------
    index : int
        Place of the preload.
    count : int
        Preloads in all.
    every : int
        0: none is held out.

    Returns
    -------
    bool
        True if kept back.
    """
    return every > 0 and 0 < index < count - 1 and index % every == every // 2


def uncoupled_cases(rng: np.random.Generator) -> tuple[Case, ...]:
    """Return the two set-ups without the bolt: each body struck by hand, no harder than 49 m/s2."""
    return tuple(
        Case(f"records/uncoupled_{body}.h5", "uncoupled", hammer(body, rng.uniform(20.0, 40.0), rng))
        for body in ("lo", "so")
    )


def plan(
    cases: int | None,
    strengths: tuple[float, ...],
    scatter: float,
    tightening: bool,
    hold_out_every: int,
    seed: np.random.SeedSequence,
) -> tuple[Case, ...]:
    """Return every test of a campaign in the order in which it is run.

    Parameters
    ----------
    cases : int or None
        Number of preloads; None: the paper's 58 with 84 loosening tests.
    strengths : tuple of float
        Hits per preload, as shares of the hammer's full strength.
    scatter : float
        Factor on `gamma_deviation`.
    tightening : bool
        Whether some tests tighten and are repeated until one loosens: 26 at full scale, else in proportion.
    hold_out_every : int
        One in so many preloads is held out; 0 for none.
    seed : numpy.random.SeedSequence
        Each source of variation has its own stream, so that changing one leaves the others alone.
    """
    place, low, high, setting, gamma, tight = (np.random.default_rng(child) for child in seed.spawn(6))
    nominal = preloads(cases, place)
    repeats = round(FULL_SCALE_TIGHTENING * nominal.size / FULL_SCALE_PRELOADS) if tightening else 0
    tightened = tightening_cases(nominal, repeats, tight)
    planned = list(uncoupled_cases(low))
    counter = 0
    for index, preload in enumerate(nominal):
        common = Case(
            "", "", planned[0].hit, float(preload), hold_out=held_out(index, nominal.size, hold_out_every)
        )

        def case(test: str, number: int, hit: Hit, factor: float, common: Case = common) -> Case:
            tension = float(common.preload or 0.0) * (1.0 + 0.002 * setting.standard_normal())
            file = f"records/{test}_{number:03d}.h5"
            return replace(common, file=file, test=test, hit=hit, tension=tension, gamma_factor=factor)

        soft = hammer("lo", LOW_MEAN + LOW_DEVIATION * low.standard_normal(), low)
        planned.append(case("coupled", index + 1, soft, 1.0))
        for sign, share in [(-1.0, 1.0)] * tightened.count(index) + [(1.0, share) for share in strengths]:
            counter += 1
            strength = share * (HAMMER_MEAN + HAMMER_DEVIATION * high.standard_normal())
            factor = sign * gamma_factor(preload, scatter, gamma)
            planned.append(case("loosening", counter, hammer("lo", strength, high), factor))
    return tuple(planned)
