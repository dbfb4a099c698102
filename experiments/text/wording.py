"""Values and keys of result files in words: numbers for people, limits, units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

_UNITS = {
    "s3_per_m4": "s³/m⁴",
    "ns_per_m": "N s/m",
    "n_per_m": "N/m",
    "percent": "%",
    "hz": "Hz",
    "kg": "kg",
    "n": "N",
    "s": "s",
    "m": "m",
}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_INITIALS = re.compile(r"\b(nrmse|rmse|bic)\b")
_MOST_VALUES = 40
NONE = "–"


def number(value: object, digits: int = 4) -> str:
    """Return a value for people: `digits` significant ones, powers of ten written out, a dash for nothing."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return NONE
    if not isinstance(value, float):
        return str(value).replace("-", "−", 1) if isinstance(value, int) else str(value)
    if value != 0 and not 1e-3 <= abs(value) < 1e6:
        mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
        return f"{mantissa} × 10{str(int(power)).translate(_SUPERSCRIPT)}".replace("-", "−", 1)
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0) if value else 0
    return f"{value + 0.0:.{decimals}f}".replace("-", "−")  # no minus before a zero


def with_limits(value: object, low: object, high: object) -> tuple[str, str]:
    """Return a value and its limits, as many digits as the limits warrant.

    Parameters
    ----------
    value : object
        A number; else a dash stands for the limits.
    low, high : object
        Its 95 % limits, in the same unit; one alone is a limit on one side.

    Returns
    -------
    tuple of str
        Value; limits.
    """
    known = [isinstance(x, int | float) and math.isfinite(x) for x in (value, low, high)]
    if not all(known):
        one_sided = known[0] and any(known[1:])
        words = f"at least {number(low, 3)}" if known[1] else f"at most {number(high, 3)}"
        return trimmed(number(value, 6)), words if one_sided else NONE
    ends = [float(x) for x in (value, low, high) if isinstance(x, int | float)]
    width, size = abs(ends[2] - ends[1]) / 2, max(abs(end) for end in ends)
    digits = 7 if width == 0 else min(max(math.floor(math.log10(size / width)) + 2, 3), 7)
    shown = [number(end, digits) for end in ends]
    return shown[0], f"{shown[1]} to {shown[2]}"


def label(key: str) -> str:
    """Return a key of a result file as words with its unit: "tension_n" is "Tension [N]"."""
    for suffix, unit in _UNITS.items():
        if key.endswith(f"_{suffix}"):
            return f"{label(key.removesuffix(f'_{suffix}'))} [{unit}]"
    words = _INITIALS.sub(lambda found: found[0].upper(), str(key).replace("_", " ").strip())
    return words[:1].upper() + words[1:]


def plain(value: object) -> str:
    """Return one cell: a number, text, a short list, or a parameter as its value with limits."""
    if isinstance(value, Mapping) and "value" in value:
        shown, limits = with_limits(value["value"], value.get("low"), value.get("high"))
        unit = str(value.get("unit") or "")
        return f"{shown} {'' if unit == '1' else unit}".strip() + (f" ({limits})" if limits != NONE else "")
    if isinstance(value, Mapping):
        return "; ".join(
            f"{label(str(key))}: {plain(item)}" for key, item in list(value.items())[:_MOST_VALUES]
        )
    if isinstance(value, list):
        text = ", ".join(plain(item) for item in value[:_MOST_VALUES])
        return text if len(value) <= _MOST_VALUES else f"{text}, … ({len(value)} values)"
    return trimmed(number(value, 5))


def trimmed(shown: str) -> str:
    """Return a number without the zeros at its end, which say nothing where limits are not known."""
    mantissa, times, power = shown.partition(" × ")
    return (mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa) + times + power


def set_words(profile: Mapping[str, object]) -> str:
    """Return the confidence set of a profiled exponent in words; an end that its range cuts is open."""
    low, high = (trimmed(number(profile.get(end), 3)) for end in ("low", "high"))
    reach = str(profile.get("reach") or "identified")
    words = {"open below": f"{high} at most", "open above": f"{low} at least"}
    return words.get(reach, f"{low} to {high}" if reach == "identified" else f"open, {low} to {high} all do")


def mappings(items: object) -> list[Mapping[str, Any]]:
    """Return the objects of a list; nothing for anything else."""
    return [item for item in items if isinstance(item, Mapping)] if isinstance(items, list) else []


def mapping(value: object) -> Mapping[str, Any]:
    """Return an object; an empty one for anything else."""
    return value if isinstance(value, Mapping) else {}
