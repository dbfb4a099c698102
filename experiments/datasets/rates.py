"""Rates that files of others state in words: "Sample rate: 25,600 Hz", `fs_kHz = 25.6`, "dt = 0.05 ms"."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from experiments.datasets.signals import NOT_UNDERSTOOD
from experiments.datasets.times import factor_of, label, unstated

_NUMBER = r"\d{1,3}(?:[ '\u00a0\u202f]\d{3})+(?:[.,]\d+)?|\d+(?:[.,]\d+)*(?:[eE][+-]?\d+)?"
_RATE = re.compile(rf"(?<![A-Za-z\d])({_NUMBER})\s*(MHz|kHz|Hz|kS/s|MS/s|S/s|Sa/s|1/s|s-1)?", re.IGNORECASE)
_STEP = re.compile(
    r"\b(?:dt|delta[ _]?[tx]|\w*interval\w*|time[ _]?step|sampl\w+ (?:period|time)|(?:[tx][ _-]?)?increment"
    r"|schrittweite)\b\W*?"
    rf"({_NUMBER})[ \])(\[]*([^\W\d]+)?",
    re.IGNORECASE,
)
_SCALES = {"mhz": 1e6, "khz": 1e3, "ks/s": 1e3, "ms/s": 1e6}


def stated_rate(text: str) -> tuple[float, tuple[float, ...]] | None:
    """Return the one rate [Hz] that a text tells and what it may mean as well, None for none or several.

    "25,600 Hz" may be twenty-five thousand or twenty-five: its other meaning is a reading.
    """
    found = {match.groups() for match in _RATE.finditer(text)}
    if with_unit := {own for own in found if own[1]}:
        found = with_unit
    if len(found) != 1:
        return None
    number, unit = found.pop()
    scale = _SCALES.get((unit or "").lower(), 1.0)
    first, *others = (scale * value for value in readings_of(number))
    if unit is None:
        others += [1e3 * first]  # in kHz
    return (first, tuple(others)) if first > 0 else None


def stated_step(text: str) -> tuple[float, tuple[float, ...]] | None:
    """Return the rate [Hz] of a step that a text tells, "dt = 0.05 ms", and its readings, None for none."""
    found = _STEP.search(text)
    if found is None:
        return None
    factor = factor_of(found[2] or "")
    rates = [1 / value for value in readings_of(found[1]) if value > 0]
    if not rates or (found[2] and factor is None):
        return None
    first, *others = [rate / (factor or 1.0) for rate in rates]
    return first, (*others, *(() if factor else unstated(first)))


def readings_of(number: str) -> tuple[float, ...]:
    """Return what a printed number may mean, likeliest first: separators of thousands and decimals differ."""
    plain = re.sub(r"[ '\u00a0\u202f]", "", number)
    marks = [mark for mark in ".," if mark in plain]
    if len(marks) == 2:  # the last one is the decimal's
        thousands = min(marks, key=plain.rindex)
        return (float(plain.replace(thousands, "").replace(",", ".")),)
    if not marks:
        return (float(plain),)
    joined = float(plain.replace(marks[0], ""))
    if plain.count(marks[0]) > 1:
        return (joined,)
    decimal = float(plain.replace(",", "."))
    if not re.fullmatch(r"[1-9]\d{0,2}[.,]\d{3}", plain):
        return (decimal,)
    return (joined, decimal) if marks[0] == "," else (decimal, joined)


_RATE_NAME = re.compile(
    r"f_?s|s_?rate|f_?sampl\w*|(?:sampl\w*|abtast|scan|acq\w*|daq)[_ ]?(?:rate|freq\w*)", re.IGNORECASE
)
_STEP_NAME = re.compile(
    r"d_?t|delta_?[tx]|[tx]_?incr?(?:ement)?|increment|time_?step|t_?s(?:ample)?|schrittweite"
    r"|(?:sampl\w*|scan|abtast)_?(?:time|interval\w*|period|zeit)",
    re.IGNORECASE,
)
_WEAK_RATE = re.compile(r"rate|frequency|sr", re.IGNORECASE)  # with a unit, or beside samples
_WEAK_STEP = re.compile(r"step|interval|period", re.IGNORECASE)
_IN_HZ = re.compile(r"(.*?[^\W_])[ _]*[\[(]?(MHz|kHz|Hz|kS/s|MS/s|S/s)[\])]?", re.IGNORECASE)
_NO_RATE = re.compile(
    r"filter|cut[ -]?off|grenz|pass\b|resol|auflös|band|carrier|träger|nyquist|number|anzahl|nombre|count"
    r"|^\W*samples?\W+\d+\W*$",
    re.IGNORECASE,
)
_RATE_LINE = re.compile(
    r"\bf_?s\b|sampl|rate|abtast|échantillon|muestreo|campion|freq|bemonster", re.IGNORECASE
)


class Told(NamedTuple):
    """Rate [Hz], None where it is one of the readings, and what the words may mean as well."""

    rate_hz: float | None
    readings: tuple[float, ...] = ()


def named_rate(name: str, value: object, *, weak: bool = False) -> Told | None:
    """Return the rate that a value tells by its name, `fs_kHz` or `dt`, None where it tells none.

    Parameters
    ----------
    name : str
        Name of the value.
    value : object
        A number, a text, or several numbers, of which one may be meant.
    weak : bool
        Whether "rate" and "step" are names enough, as they are beside samples.

    Returns
    -------
    Told or None
        Rate and readings.
    """
    in_hz = _IN_HZ.fullmatch(name)
    base, scale = (in_hz[1], _SCALES.get(in_hz[2].lower(), 1.0)) if in_hz else (name, None)
    if _RATE_NAME.fullmatch(base) or (
        (weak or scale) and (_WEAK_RATE.fullmatch(base) or (scale and base in "fF"))
    ):
        return _rate_by(value, scale)
    base, unit = label(name)
    if _STEP_NAME.fullmatch(name) or _STEP_NAME.fullmatch(base) or (weak and _WEAK_STEP.fullmatch(base)):
        return _step_by(value, None if _STEP_NAME.fullmatch(name) else factor_of(unit))
    return None


def _rate_by(value: object, scale: float | None) -> Told | None:
    if isinstance(value, str):
        found = stated_rate(value)
        if found is None:
            return Told(None, (NOT_UNDERSTOOD,)) if value.strip() else None
        return Told(scale * found[0]) if scale and not re.search("[a-z]", value.lower()) else Told(*found)
    numbers = _numbers(value)
    if len(numbers) > 1:
        return Told(None, tuple((scale or 1.0) * number for number in numbers))
    if not numbers:
        return None
    return Told(scale * numbers[0]) if scale else Told(numbers[0], (1e3 * numbers[0],))


def _step_by(value: object, factor: float | None) -> Told | None:
    if isinstance(value, str):
        found = stated_step(f"dt = {value}")
        if found is None:
            return Told(None, (NOT_UNDERSTOOD,)) if value.strip() else None
        known = factor and not re.search(r"[^\W\de]", value)
        return Told(found[0] / factor) if factor and known else Told(*found)
    rates = tuple(1 / number for number in _numbers(value))
    if len(rates) > 1:
        return Told(None, tuple(rate / (factor or 1.0) for rate in rates))
    if not rates:
        return None
    return Told(rates[0] / factor) if factor else Told(rates[0], unstated(rates[0]))


def _numbers(value: object) -> tuple[float, ...]:
    """Return the numbers above zero of a value, none of a truth."""
    if isinstance(value, bool):
        return ()
    items = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
    found = (float(item) for item in items if isinstance(item, int | float) and not isinstance(item, bool))
    return tuple(number for number in found if 0 < number < float("inf"))


def rate_above(lines: Sequence[str]) -> Told | None:
    """Return the rate that remarks tell, "Sample rate: 25,600 Hz", "dt = 50 us"; of several any may be it."""
    short = [line for line in lines if len(line) < 120 and not _NO_RATE.search(line)]
    steps = {line: stated_step(line) for line in short}
    told = [steps[line] or (stated_rate(line) if _RATE_LINE.search(line) else None) for line in short]
    rates = [*dict.fromkeys(rate for rate in told if rate is not None)]
    if len({rate for rate, _ in rates}) > 1:
        return Told(None, tuple(reading for rate, others in rates for reading in (rate, *others)))
    return Told(*rates[0]) if rates else None
