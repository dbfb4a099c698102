"""How much an undeclared effect changes, and effects of a strength drawn at random."""

from dataclasses import dataclass, replace
from functools import lru_cache
from math import exp, log

import numpy as np
from scipy import optimize

from experiments.rig.campaign import Laboratory
from experiments.rig.excitation import FloatArray, Hit, contact_time
from experiments.rig.kinds import Number
from experiments.rig.plant import Plant
from experiments.rig.schedule import Case
from experiments.rig.sensors import CALIBRATION, Instruments
from experiments.rig.undeclared import Undeclared

PRELOADS = (12.0, 100.0, 700.0)
HITS = (30.5, 1608.7)
IMPACT, DURATION = 0.1, 0.7
WEAKEST = -9.0
"""Logarithm of the share of the strongest effect below which none is looked for."""

ATTEMPTS = 5
"""Draws of the other parameters before an effect that is felt too little is taken all the same."""


@dataclass(frozen=True)
class Influence:
    """Changes in percent, means over trial tests without noise: 12, 100, 700 N and hits of 30.5 and 1608.7 N.

    Attributes
    ----------
    motion : float
        RMS change of a displacement over its RMS, 0.6 s from the hit; the largest of LO, SO and relative.
    loss : float
        Change of the measured loss over the loss, hard hits only.
    reading : float
        RMS change of a channel over its RMS, the tension's over the loss, or of its level; the largest.
    percent : float
        What counts: of a reading or a sensor's fault the larger of loss and reading, else of motion and loss.
    """

    motion: float
    loss: float
    reading: float
    percent: float


@dataclass(frozen=True)
class Trial:
    """Signals of one trial test from the hit on, the mean before it taken off where there is one."""

    motion: tuple[FloatArray, ...]
    channels: tuple[FloatArray, ...]
    tension: FloatArray
    loss: float
    level: float


@lru_cache(maxsize=2 * len(PRELOADS) * len(HITS))  # those of a rig and of the same one with an effect
def trial(plant: Plant, preload: float, strength: float) -> Trial:
    """Run one trial test without noise.

    Parameters
    ----------
    plant : Plant
        The rig.
    preload : float
        Tension before the hit [N].
    strength : float
        Peak force on LO [N].

    Returns
    -------
    Trial
        Signals from the hit on.

    Raises
    ------
    ValueError
        If the motion diverges.
    """
    kit = Instruments().scaled(0.0)
    hit = Hit("lo", strength, IMPACT, contact_time(strength))
    case = Case("", "loosening", hit, preload, preload)
    streams = [np.random.default_rng(0) for _ in range(6)]
    motion, channels = Laboratory(plant, kit, DURATION).test(case, plant, streams)
    struck = np.searchsorted(motion.time, IMPACT)
    still = slice(np.searchsorted(motion.time, 0.0), struck)

    def displacement_of(displacement: FloatArray) -> FloatArray:
        return displacement[struck:] - np.mean(displacement[still])

    lo, so = displacement_of(motion.displacement_lo), displacement_of(motion.displacement_so)
    strain = channels.pop("strain").samples
    first, second, third = CALIBRATION
    tension = strain * (first + strain * (second + strain * third))
    early, late = round(IMPACT * kit.tension_rate_hz), round(0.3 * kit.tension_rate_hz)
    level = float(np.mean(tension[:early]))
    tension = tension - level
    after = round(IMPACT * kit.motion_rate_hz)
    seen = tuple(np.asarray(channel.samples[after:]) for channel in channels.values())
    return Trial((lo, so, lo - so), seen, tension[early:], -float(np.mean(tension[-late:])), level)


@lru_cache(maxsize=4)
def reference(plant: Plant) -> dict[tuple[float, float], Trial]:
    """Trial tests of the rig without what is added."""
    return {(preload, hit): trial(plant, preload, hit) for preload in PRELOADS for hit in HITS}


def changed(after: tuple[FloatArray, ...], before: tuple[FloatArray, ...]) -> FloatArray:
    """RMS change of signals over their RMS."""
    return np.array(
        [
            np.sqrt(np.mean((one - other) ** 2) / np.mean(other**2))
            for one, other in zip(after, before, strict=True)
        ]
    )


def influence(effect: Undeclared, plant: Plant | None = None) -> Influence:
    """Compare the rig with and without an effect in six short tests without noise.

    Parameters
    ----------
    effect : Undeclared
        The effect.
    plant : Plant or None
        The rig to which it is added; None: that of the paper.

    Returns
    -------
    Influence
        Percent; infinite where the motion diverges.
    """
    if not any(effect.parameters[name] for name in effect.kind.strengths):
        return Influence(0.0, 0.0, 0.0, 0.0)
    standing = replace(plant or Plant(), effects=())
    added = replace(standing, effects=(effect,))
    motion, loss, reading = [], [], []
    for (preload, hit), before in reference(standing).items():
        try:
            after = trial(added, preload, hit)
        except ValueError:  # diverged
            return Influence(np.inf, np.inf, np.inf, np.inf)
        motion.append(changed(after.motion, before.motion))
        reading.append(changed(after.channels, before.channels))
        if hit == max(HITS):
            change = np.sqrt(np.mean((after.tension - before.tension) ** 2))
            lower = (after.level - before.level) / before.level
            loss.append([(after.loss - before.loss) / before.loss, change / before.loss, lower])
    motion_share, reading_share = (
        float(np.max(np.mean(motion, axis=0))),
        float(np.max(np.mean(reading, axis=0))),
    )
    lost, shown, shifted = (float(share) for share in np.mean(np.abs(loss), axis=0))
    reading_share = max(reading_share, shown, shifted)
    largest = reading_share if effect.kind.acts in ("reading", "fault") else motion_share
    return Influence(100.0 * motion_share, 100.0 * lost, 100.0 * reading_share, 100.0 * max(largest, lost))


def draw(
    rng: np.random.Generator,
    name: str,
    enters: str = "",
    percent: tuple[float, float] = (3.0, 60.0),
    plant: Plant | None = None,
) -> Undeclared:
    """Draw an effect whose influence lies in a range.

    What is no strength is drawn from its plausible range, evenly in the logarithm where that is positive.
    Of several strengths one or more are taken, of either sign where that can be; they are then scaled
    together until the influence is what was drawn, evenly in the logarithm, or the end of the plausible
    range is reached.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all that is drawn.
    name, enters : str
        Kind, and place; empty for the usual one.
    percent : tuple of float
        Smallest and largest influence [%].
    plant : Plant or None
        The rig to which it is added; None: that of the paper.

    Raises
    ------
    ValueError
        If there is no such kind or place.
    """
    target = exp(rng.uniform(log(percent[0]), log(percent[1])))
    best, felt = Undeclared(name, enters), -1.0
    for _ in range(ATTEMPTS):
        effect, reached = scaled_to(strongest(best, rng), target, plant)
        if reached > felt:
            best, felt = effect, reached
        if felt >= percent[0]:
            break
    return best


def strongest(usual: Undeclared, rng: np.random.Generator) -> Undeclared:
    """Draw which strengths an effect has, each at the end of its plausible range, and all else."""
    numbers, names = usual.kind.numbers_at(usual.enters), usual.kind.strengths
    free = [key for key in names if numbers[key].low < numbers[key].high]
    taken = set(rng.permutation(free)[: rng.integers(1, len(free) + 1)])
    values = {}
    for key, number in numbers.items():
        if key not in free:
            values[key] = number.value if key in names else drawn(number, rng)
        elif key in taken:
            values[key] = rng.choice([number.low, number.high]) if number.low < 0.0 else number.high
        else:
            values[key] = 0.0
    return replace(usual, parameters=values)


def drawn(number: Number, rng: np.random.Generator) -> float:
    """Draw a parameter from its plausible range; of one that lies about zero the sign alone."""
    _, _, low, high = number
    if low == -high:
        return float(rng.choice([low, high]))
    if low > 0.0:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))


def scaled_to(strongest: Undeclared, percent: float, plant: Plant | None = None) -> tuple[Undeclared, float]:
    """Weaken an effect until its influence is so many percent, to a tenth of that; or leave it as it is.

    Parameters
    ----------
    strongest : Undeclared
        The effect at its strongest.
    percent : float
        Influence that is wanted [%].
    plant : Plant or None
        The rig to which it is added; None: that of the paper.

    Returns
    -------
    tuple of Undeclared and float
        The effect and its influence [%]. Brent's method on the logarithms of strength and influence.
    """
    felt: dict[float, float] = {}

    def excess(exponent: float) -> float:
        if exponent == WEAKEST:  # never simulated: nothing is felt there
            return WEAKEST
        felt[exponent] = influence(strongest.scaled(exp(exponent)), plant).percent
        ratio = log(min(max(felt[exponent] / percent, exp(WEAKEST)), exp(-WEAKEST)))
        return 0.0 if abs(ratio) < 0.1 else ratio

    if excess(0.0) <= 0.0:
        return strongest, felt[0.0]
    exponent = float(optimize.brentq(excess, WEAKEST, 0.0, xtol=0.01))
    return strongest.scaled(exp(exponent)), felt[exponent]
