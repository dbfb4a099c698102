"""Times of files of others: which signal is one, its unit, and the rate and start that it tells.

A signal is a time by its name, in many languages. A weak name (`t`, "Seconds") or a unit of time counts where
the samples rise evenly. Units come from the file or from the label: "Time [ms]", `t_us`.
"""

from __future__ import annotations

import re
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from experiments.datasets.collected import SourceError
from experiments.datasets.vectors import rate_of
from rom.model.units import parse_unit

UNITS: dict[str, float] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden"), 1.0),
    **dict.fromkeys(("seconde", "secondes", "segundo", "segundos", "secondi", "секунд", "с", "秒"), 1.0),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("millisekunde", "millisekunden", "millisecondes", "milisegundos", "мс"), 1e-3),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("mikrosekunde", "mikrosekunden", "microsecondes", "microsegundos", "мкс"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds", "nanosekunden"), 1e-9),
    **dict.fromkeys(("min", "mins", "minute", "minutes", "minuten", "minutos", "minuti"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours", "std", "stunde", "stunden"), 3600.0),
    **dict.fromkeys(("heure", "heures", "hora", "horas", "ore"), 3600.0),
    **dict.fromkeys(("d", "day", "days", "tag", "tage", "jours", "dias"), 86400.0),
}
SHOWN = "s, ms, us, ns, min, h, d"
ABSOLUTE_S = 1e8  # seconds that lie three years after zero count from an epoch, not from a trigger
_FACTORS = sorted(set(UNITS.values()))
_NONE = ("", "-", "1", "none", "n/a", "no unit")
_STRONG = frozenset((
    "time", "timestamp", "timestamps", "datetime", "timebase", "elapsed", "epoch", "abscissa",
    "abszisse", "abscisse", "zeit", "zeitstempel", "zeitachse", "messzeit", "uhrzeit", "laufzeit",
    "temps", "horodatage", "tiempo", "tempo", "tijd", "tijdstip", "tid", "tidsstempel", "tidspunkt",
    "czas", "aika", "čas", "vrijeme", "idő", "laikas", "aeg", "zaman", "timp", "время", "χρόνος", "时间",
    "時間", "時刻", "시간", "zeitpunkt", "zeitvektor", "timeaxis", "timevector", "sampletime", "tidpunkt",
    "instant", "heure", "hora", "uhr", "vreme",
))  # fmt: skip
_X = frozenset(("value", "values", "wert", "werte", "axis", "achse", "data", "valeur", "valor", "waarde"))
_CAMEL = re.compile(r"(?<=[a-zß-ÿ])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_BRACKETS = re.compile(r"^(.*\S)\s*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$")
_SUFFIX = re.compile(r"^(.*[^\W_].*?)(?:\s+in\s+|\s*/\s*|\s*,\s*|_|\s+)([^\W\d_]+)$")


class Vector(Protocol):
    """What this module asks of a signal."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def samples(self) -> npt.NDArray[np.generic]: ...  # noqa: D102
    @property
    def unit(self) -> str: ...  # noqa: D102


class Clock(NamedTuple):
    """Rate [Hz], start [s] (None: not stated), who told them, and rates that the numbers might mean too."""

    rate_hz: float
    start_s: float | None
    told_by: str
    readings: tuple[float, ...] = ()


def factor_of(unit: str) -> float | None:
    """Return the factor from a unit of time to s, None where it is none."""
    plain = unit.strip(" []().").replace("µ", "u").replace("μ", "u")
    return UNITS.get(plain) or (UNITS.get(plain.lower()) if len(plain) > 2 else None)


def label(name: str) -> tuple[str, str]:
    """Return a label without its unit, and the unit, "" for none: "Force [kN]", "Zeit in ms", `t_us`.

    Behind anything but brackets only units of time count.
    """
    if bracketed := bracketed_unit(name):
        return bracketed
    camel = _CAMEL.sub("_", name).lower()  # `tMs`
    for spelt, shortest in ((name, 1), (camel, 2)):
        suffix = _SUFFIX.match(spelt)
        if suffix and len(suffix[2]) >= shortest and factor_of(suffix[2]):
            return suffix[1], suffix[2]
    return name, ""


def bracketed_unit(name: str) -> tuple[str, str] | None:
    """Return a label without its unit, and the unit, where it stands in brackets."""
    found = _BRACKETS.match(name)
    if found is None:
        return None
    base, unit = found.groups()
    sure = "[" in name[len(base) :] or factor_of(unit) or _is_unit(unit)
    return (base, unit) if sure else None


def _is_unit(text: str) -> bool:
    try:
        return any(parse_unit(text).powers) if text and not text.isdigit() else False
    except ValueError:
        return False


def says_time(name: str) -> bool:
    """Return whether a name says that it is a time, whatever the samples."""
    words = _words(label(name)[0])
    return not _STRONG.isdisjoint(words) or (words[:1] == ["x"] and not _X.isdisjoint(words[1:2]))


def _words(base: str) -> list[str]:
    last = re.split(r"[./]", base)[-1] or base
    return [word.lower() for word in re.findall(r"[^\W\d_]+", _CAMEL.sub(" ", last))]


def is_time(signal: Vector) -> bool:
    """Return whether a signal is the time of others, by its name, or by unit or weak name and its samples."""
    if signal.samples.dtype.kind in "Mm":
        return True
    unit = signal.unit.strip()
    if unit.lower() not in _NONE and factor_of(unit) is None and _is_unit(unit):
        return False  # of another quantity
    if says_time(signal.name):
        return True
    base, of_label = label(signal.name)
    weak = re.split(r"[./]", base)[-1][:1] == "t" and _words(base)[:1] == ["t"]
    weak |= factor_of(unit) is not None or factor_of(of_label) is not None or factor_of(base) is not None
    return weak and rises_evenly(signal)


def rises_evenly(signal: Vector) -> bool:
    """Return whether samples rise by even steps."""
    try:
        rate_of(signal.name, _relative(signal.samples))
    except SourceError:
        return False
    return True


def is_count(signal: Vector) -> bool:
    """Return whether samples are whole numbers that rise by one: they tell no rate."""
    if signal.samples.dtype.kind not in "iuf":
        return False
    numbers = np.asarray(signal.samples, dtype=np.float64)
    return bool(numbers[0] % 1 == 0 and (np.diff(numbers) == 1).all())


def _relative(samples: npt.NDArray[np.generic]) -> npt.NDArray[np.float64]:
    """Return samples less the first, dates in s: large numbers lose digits otherwise."""
    values = np.asarray(samples)
    if values.dtype.kind in "Mm":
        ticks = values.astype(f"{values.dtype.kind}8[ns]").astype(np.int64)
        return np.asarray(1e-9 * (ticks - ticks[:1]), dtype=np.float64)
    numbers = np.asarray(values, dtype=np.float64)
    return numbers - numbers[:1]


def clock_of(file: str, time: Vector, unit: str | None = None, scale: float | None = None) -> Clock:
    """Return what a time tells.

    Parameters
    ----------
    file : str
        Name of its file, for messages.
    time : Vector
        The time, n samples.
    unit : str, optional
        Unit by the map.
    scale : float, optional
        Factor to s by the map.

    Returns
    -------
    Clock
        Rate and start; where no unit is told, s is taken and the rates in other units are its `readings`. So
        they are where the name is a unit, such as "Stunde", and may be a mere name.

    Raises
    ------
    SourceError
        If the times do not rise evenly or their unit is not one of time.
    """
    where = f"{file}: {time.name}"
    factor, known = _factor(where, time, unit, scale)
    try:
        rate_hz = rate_of(where, factor * _relative(time.samples))
    except SourceError as fault:
        raise SourceError(f"{fault}; give rate_hz in [channels]") from None
    start_s = _start(time, factor)
    readings = () if known else unstated(rate_hz, factor)
    return Clock(rate_hz, start_s, f'the time "{time.name}"', readings)


def _start(time: Vector, factor: float) -> float:
    first = np.asarray(time.samples[:1])
    if first.dtype.kind in "Mm":
        return 1e-9 * float(first.astype(f"{first.dtype.kind}8[ns]").astype(np.int64)[0])
    return factor * float(first.astype(np.float64)[0])


def unstated(rate_hz: float, factor: float = 1.0) -> tuple[float, ...]:
    """Return the rates [Hz] that steps may mean in other units than that of `factor` to s."""
    return tuple(rate_hz * factor / other for other in _FACTORS if other != factor)


def _factor(where: str, time: Vector, unit: str | None, scale: float | None) -> tuple[float, bool]:
    """Return the factor to s and whether anybody told it."""
    if scale is not None:
        return scale, True
    if time.samples.dtype.kind in "Mm":
        return 1.0, True
    base, of_label = label(time.name)
    told = [text for text in ([unit] if unit else [time.unit, of_label]) if text.strip().lower() not in _NONE]
    factors = {factor_of(text) for text in told if text is not of_label or factor_of(text)}
    remedy = f'give "{time.name}" = {{channel = "time", unit = "ms"}} or rate_hz in [channels]'
    if None in factors:
        raise SourceError(f'{where}: found the unit "{told[0]}" of a time, expected one of {SHOWN}; {remedy}')
    if len(factors) > 1:
        raise SourceError(f'{where}: found the unit "{told[0]}" and a label that says "{told[1]}"; {remedy}')
    return (float(factors.pop() or 1.0), True) if factors else (factor_of(base) or 1.0, False)
