"""Damage of a channel other than flat tops: overflow codes, wrap-around, dropouts, windows, settling sensors,
strains beyond their calibration.

Each test keeps silent unless the evidence is strong, and none needs a model.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, stats

from rom.campaign.campaign import CampaignSettings, Record
from rom.campaign.channels import BOLT_CHANNELS, MOTIONS, Channel, FloatArray
from rom.criteria.number import Numerical
from rom.criteria.suspicions import Suspicions
from rom.signals.calibration import Calibration
from rom.signals.hits import Hit

BEYOND = "strain beyond its calibration"
HANN = "Hann window"
_ROUNDING: Numerical[float] = 8 * np.finfo(float).eps  # of a number, which is no digit of a channel
WINDOW_PARTS: Numerical[int] = 8


@dataclass(frozen=True)
class Damage:
    """What is wrong with a channel: a line for people, and the likeliest cause."""

    channel: str
    finding: str
    likely: str

    @property
    def at_hit(self) -> bool:
        """Whether samples of the hit itself may be wrong, so that they tell nothing else."""
        of_motion = self.likely == "dropouts" and self.channel not in BOLT_CHANNELS
        return of_motion or self.likely in ("overload", "wrap-around", "channel frozen", HANN)


def damages(record: Record, hit: Hit | None, rules: Suspicions) -> Iterator[Damage]:
    """Yield what is wrong with the channels of a record.

    Parameters
    ----------
    record : Record
        The record.
    hit : Hit, optional
        Its hit, where there is one.
    rules : Suspicions
        The numbers that decide.
    """
    hit_s = None if hit is None else hit.start / hit.force.rate_hz
    for name, channel in record.channels.items():
        if not np.ptp(channel.samples):
            continue  # a channel that shows nothing is told as such
        family, of_hammer = name.partition("_")[0], name.startswith("force_") and record.test != "driven"
        if of_hammer:
            found = _wrapped(channel, rules)
            if _lasts(channel, rules):  # else a blow may be one sample
                found = _overflow(channel, None, rules) or found
        else:
            # dropouts and lone samples first: unwrapped by the range that they make they look smooth
            found = _dropped(channel, rules) if name in BOLT_CHANNELS else None
            found = found or _overflow(channel, hit_s, rules) or _wrapped(channel, rules)
        if hit_s is not None and family in MOTIONS:  # few digits behind a window are zeros for a while
            found = found or _windowed(channel, hit_s, rules) or _rounded(channel, hit_s, rules)
        if hit_s is not None and not of_hammer:
            found = found or _held(channel, rules)
        if hit_s is not None and family == "acceleration" and not found:
            moves = _moving(channel, hit_s, rules)
            found = _settling(channel, hit_s, rules, moves is not None) or moves
        if found:
            yield Damage(name, f"{name} {found[0]}", found[1])


def beyond_calibration(record: Record, settings: CampaignSettings, rules: Suspicions) -> Iterator[Damage]:
    """Yield a strain whose readings lie where the calibration falls: they tell no tension.

    Parameters
    ----------
    record : Record
        The record.
    settings : CampaignSettings
        The campaign's, for the calibration.
    rules : Suspicions
        The numbers that decide.
    """
    name = next((name for name in BOLT_CHANNELS if name in record.channels), None)
    if name != "strain" or settings.bolt is None or not settings.bolt.calibration:
        return
    strain = record.channels[name].samples
    low, high = Calibration(tuple(settings.bolt.calibration)).rising_range
    share = float(np.mean((strain < low) | (strain > high)))
    if share <= rules.beyond_calibration:
        return
    ends = [f"{end:.4g}" for end in (low, high) if np.isfinite(end)]
    finding = (
        f"strain from {strain.min():.4g} to {strain.max():.4g} is for {100 * share:.3g} % of the record "
        f"beyond {' or '.join(ends)}, where its calibration stops rising: no tension is told there"
    )
    yield Damage(name, finding, BEYOND)


def _lasts(channel: Channel, rules: Suspicions) -> bool:
    """Whether a hammer's contact is longer than lone samples."""
    smooth = ndimage.median_filter(channel.samples, 2 * rules.lone_samples + 1)
    height = np.abs(smooth - np.median(smooth))
    seen = height.max() > rules.force_noise * white_noise(channel.samples)
    return bool(seen and np.sum(height > 0.5 * height.max()) > rules.lone_samples)


def _overflow(channel: Channel, hit_s: float | None, rules: Suspicions) -> tuple[str, str] | None:
    """Lone samples far from all beside them: the code of an overrun input. A blow may be as short."""
    samples = channel.samples
    smooth = ndimage.median_filter(samples, 2 * rules.lone_samples + 1)
    away = np.abs(samples - smooth)
    if hit_s is not None:
        guard = np.array([hit_s - rules.hit_guard_s, hit_s + rules.hit_guard_s]) * channel.rate_hz
        away[slice(*np.maximum(guard.round().astype(int), 0))] = 0.0
    digits = rules.held_digits * _digit(np.abs(np.diff(samples)), rules)
    if away.max() <= max(digits, rules.lone_height * np.ptp(smooth)):
        return None
    lone = away > 0.5 * away.max()
    others = float(away[~lone].max(initial=0.0))
    if others > rules.lone_share * away.max():
        return None
    value = samples[np.argmax(away)]
    return f"has {int(lone.sum())} lone samples of {value:.4g}, far from all beside them", "overload"


def _wrapped(channel: Channel, rules: Suspicions) -> tuple[str, str] | None:
    """Jumps over the whole range without which the signal is smooth, goes beyond it and comes back."""
    low, high = float(channel.samples.min()), float(channel.samples.max())
    steps = np.abs(np.diff(channel.samples))
    if (
        high - low <= rules.wrap_noise * white_noise(channel.samples)
        or np.sum(steps > rules.wrap_step * (high - low)) < rules.lone_samples
    ):
        return None
    whole = np.unwrap(channel.samples, period=high - low)
    smooth = np.abs(np.diff(whole)).max() < rules.wrap_smooth * (high - low)
    beyond = max(whole.max() - high, low - whole.min()) > rules.wrap_beyond * (high - low)
    height = np.abs(whole - np.median(whole))
    lasting = np.sum(height > 0.5 * height.max()) > rules.wrap_lasts
    if not (smooth and beyond and lasting and abs(whole[-1] - channel.samples[-1]) < 0.5 * (high - low)):
        return None
    return f"jumps from one end of its range, {low:.4g} to {high:.4g}, to the other", "wrap-around"


def _dropped(channel: Channel, rules: Suspicions) -> tuple[str, str] | None:
    """Samples near zero amid a level far from it, to which they fall and from which they rise at once."""
    level, noise = float(np.median(channel.samples)), white_noise(channel.samples)
    if level == 0.0:
        return None
    shares = channel.samples / level
    fallen = 0
    for (run,) in ndimage.find_objects(ndimage.label(np.abs(shares) < rules.dropped_to)[0]):
        before, after = shares[: run.start][-rules.drop_beside :], shares[run.stop :][: rules.drop_beside]
        if not (len(before) and len(after)) or min(before.mean(), after.mean()) < rules.dropped:
            continue
        long = run.stop - run.start
        seen = abs(level) * np.sqrt(min(long, rules.drop_beside)) > rules.drop_noise * noise
        fallen += seen or (long >= rules.drop_run and not channel.samples[run].any())
    if not fallen:
        return None
    return f"falls to zero {fallen} times amid a level of {level:.4g}", "dropouts"


def _held(channel: Channel, rules: Suspicions) -> tuple[str, str] | None:
    """Runs of one value amid motion of many digits, or from there to the end of the record."""
    samples, steps = channel.samples, np.abs(np.diff(channel.samples))
    moved = np.flatnonzero(steps)
    if len(moved) < rules.shortest:
        return None
    starts, stops = moved[:-1] + 1, moved[1:] + 1
    least = max(float(steps[moved].min()), _ROUNDING * float(np.abs(samples).max()))
    digit = max(_digit(steps, rules), least)
    floor = np.maximum(digit, _about_zero(samples, 4 * rules.shortest))
    usual = rules.held_run * max(float(np.median(stops - starts)), 1.0)
    long = stops - starts >= usual
    runs = [
        slice(start, stop)
        for start, stop in zip(starts[long], stops[long], strict=True)
        if steps[stop - 1] > rules.held_jump * least
        and _moves_beside(samples, start, stop, rules.held_digits * floor[start])
    ]
    last, end = stops[-1], len(samples)
    lasts = end - last >= max(usual, rules.shortest)
    if lasts and white_noise(samples[:last]) > rules.held_digits * floor[last]:
        runs.append(slice(last, end))
    if not runs or (channel.name in BOLT_CHANNELS and not samples[runs[0].start]):
        return None  # a loose bolt rests at no tension
    count, lasting = len(runs), sum(run.stop - run.start for run in runs)
    if not any(samples[run.start] for run in runs):
        return f"falls to zero {count} times, for {lasting} samples", "dropouts"
    return f"keeps one value {count} times, for {lasting} samples", "channel frozen"


def _moves_beside(samples: FloatArray, start: int, stop: int, least: float) -> bool:
    """Whether a signal goes further than this in half the time both before and after it keeps one value.

    Where it turns it goes by 1.5 digits in that time, at an inflection by 3.5 and more, where several modes
    pass for rest: but then it goes on by single digits, where a channel that was frozen jumps.
    """
    half = (stop - start) // 2
    before, after = samples[max(start - half, 0) : start], samples[stop : stop + half]
    return bool(len(before) and len(after) and min(np.ptp(before), np.ptp(after)) > least)


def _about_zero(samples: FloatArray, size: int) -> FloatArray:
    """Least height about zeros, nothing elsewhere: behind a window digits grow smaller and smaller."""
    height = np.where(samples == 0, np.inf, np.abs(samples))
    return np.where(samples == 0, ndimage.minimum_filter1d(height, size), 0.0)


def _digit(steps: FloatArray, rules: Suspicions) -> float:
    """Return about a digit of a channel whose samples often repeat the one before, nothing of a fine one."""
    moved = np.flatnonzero(steps)
    if len(moved) < 2 or np.mean(np.diff(moved) > 1) < rules.repeated:
        return 0.0
    return float(np.median(steps[moved]))  # resampled since, digits are no multiples of one step


def white_noise(samples: FloatArray) -> float:
    """Root mean square of what changes from sample to sample, motion taken out by third differences."""
    return float(1.4826 * np.median(np.abs(np.diff(samples, 3))) / np.sqrt(20.0))


def _sharp_noise(samples: FloatArray) -> float:
    """The same with the scatter of a root mean square: of all but what a spike is."""
    steps = np.diff(samples, 3)
    within = np.abs(steps) <= 4.0 * 1.4826 * np.median(np.abs(steps))
    return float(np.sqrt(np.mean(steps[within] ** 2) / 20.0))


def _size_of_digits(part: FloatArray, rules: Suspicions) -> float:
    """The digit of a part whose noise few digits hide, nothing of another: a window fades digits too."""
    steps = np.abs(np.diff(part))
    largest = float(steps.max())
    changes = steps[steps > rules.one_digit * largest]
    between = np.sum(steps > rules.no_digit * largest) - len(changes)
    in_digits = len(changes) >= rules.digit_changes and between <= rules.repeated * len(steps)
    return float(np.median(changes)) if in_digits else 0.0


def _levels(parts: Iterable[FloatArray], rules: Suspicions) -> tuple[FloatArray, FloatArray]:
    """The noise of every part of a channel, and the digit."""
    each = [(_sharp_noise(part), _size_of_digits(part, rules)) for part in parts]
    noise, digits = np.transpose(each)
    return noise, digits


def _windowed(channel: Channel, hit_s: float, rules: Suspicions) -> tuple[str, str] | None:
    """Noise that fades evenly along the record, or digits: an analyser's exponential window."""
    hit, guard = round(hit_s * channel.rate_hz), round(rules.hit_guard_s * channel.rate_hz)
    before, after = channel.samples[: max(hit - guard, 0)], channel.samples[hit + guard :]
    size = len(after) // WINDOW_PARTS
    if size < rules.shortest or len(before) < rules.shortest:
        return None
    last = WINDOW_PARTS // 2  # before it the ringing of fast modes may pass for noise
    parts = [before[-size:], *after[last * size : WINDOW_PARTS * size].reshape(-1, size)]
    time = np.arange(last, WINDOW_PARTS) * size / channel.rate_hz
    noise, digits = _levels(parts, rules)
    for quiet, levels, straight in (
        (noise[0], noise[1:], rules.window_straight if noise[0] else np.inf),
        (digits[0], digits[1:], rules.window_straight if digits[0] else rules.window_exact),
    ):
        if levels.min() <= 0 or not np.ptp(levels):
            continue
        slope, at_hit = np.polyfit(time, np.log(levels), 1)
        fallen = levels[-1] / (quiet or np.exp(at_hit))  # before the hit no digit may change
        if fallen < rules.window_noise and np.corrcoef(time, np.log(levels))[0, 1] < -straight:
            remedy = f"multiply motions and force by exp({-slope:.3g} (t - t_hit))"
            found = f"has a noise that fades with {-slope:.3g} 1/s to {fallen:.2g} of that before the hit"
            return f"{found}: {remedy}", "exponential window"
    return None


def _rounded(channel: Channel, hit_s: float, rules: Suspicions) -> tuple[str, str] | None:
    """Noise or digits that swell and fade as a Hann window does, away from the hit and the ends."""
    count = 2 * WINDOW_PARTS
    size = len(channel.samples) // count
    if size < rules.shortest:
        return None
    parts = channel.samples[: size * count].reshape(count, size)
    middles = (np.arange(count) + 0.5) / count
    hit = hit_s * channel.rate_hz / (size * count)
    quiet = ((middles < hit - 1 / count) | (middles > 0.5)) & (np.arange(count) % (count - 1) > 0)
    noise, digits = _levels(parts, rules)
    for levels, fewest in ((noise, np.sum(quiet)), (digits, count // 3)):
        known = quiet & (levels > 0)
        if np.sum(known) < fewest:
            continue
        off = np.log(levels[known] / np.sin(np.pi * middles[known]) ** 2)
        if stats.median_abs_deviation(off, scale="normal") < rules.hann_like:
            return "has a noise that swells and fades with the record: measure it without a window", HANN
    return None


def _settling(channel: Channel, hit_s: float, rules: Suspicions, moves: bool) -> tuple[str, str] | None:
    """A sensor that runs towards its rest when the hit comes; far from it, unless its mean moves on later."""
    stop = round(0.98 * hit_s * channel.rate_hz)
    before, after = channel.samples[:stop], channel.samples[round(hit_s * channel.rate_hz) :]
    if len(before) < rules.shortest or len(after) < rules.shortest:
        return None
    time = np.linspace(-1, 1, stop)
    trend = np.polynomial.Polynomial.fit(time, before, 3)(time)
    steps = np.diff(trend)
    run = float(np.ptp(trend))
    one_way = np.all(steps <= 0) or np.all(steps >= 0)
    explained = trend.var() > rules.settling_share * (before.var() - white_noise(before) ** 2)
    noise = white_noise(before)
    large = run > max(rules.settling_noise * noise, rules.settling_size * after.std())
    large |= moves and run > 2 * rules.mean_errors * noise / np.sqrt(stop)
    if not (one_way and explained and large):
        return None
    return f"still runs by {run:.3g} m/s2 before the hit", "sensor still settling"


def _moving(channel: Channel, hit_s: float, rules: Suspicions) -> tuple[str, str] | None:
    """A mean at the end that is not that before the hit: it would be a speed beyond all that the hit gave."""
    rate = channel.rate_hz
    before, after = channel.samples[: round(0.98 * hit_s * rate)], channel.samples[round(hit_s * rate) :]
    end = after[len(after) // 2 :]
    if len(before) < rules.shortest or len(end) < rules.shortest:
        return None
    rest, mean = (float(np.average(part, weights=np.hanning(len(part)))) for part in (before, end))
    moved = abs(mean - rest)
    given = float(np.abs(np.cumsum(after[: len(after) // 10] - rest)).max())  # speed times rate
    error = white_noise(before) / np.sqrt(min(len(before), len(end)))
    if moved * len(end) <= rules.mean_speed * given or moved < max(
        rules.mean_errors * error, rules.mean_size * after.std()
    ):
        return None
    return f"has a mean at the end that differs by {moved:.3g} m/s2 from that before the hit", "mean moves"
