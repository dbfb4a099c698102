"""What the batteries over all effects share: equations as people read them, units, prescribed motions."""

import re
from ctypes import CFUNCTYPE, POINTER, c_double
from functools import reduce
from math import prod

import numpy as np

from rom.effects import CATALOGUE, Member

_KERNEL = CFUNCTYPE(c_double, *[c_double] * 6, *[POINTER(c_double)] * 4)
_WORDS = {
    "abs": np.abs,
    "cos": np.cos,
    "exp": np.exp,
    "log": np.log,
    "max": lambda *values: reduce(np.maximum, values),
    "min": np.minimum,
    "pi": np.pi,
    "sign": np.sign,
    "sin": np.sin,
    "step": lambda y: 1.0 * (y > 0),
    "tanh": np.tanh,
    "where": np.where,
}
# numbers in equations that carry a unit
_LITERALS = {"1e-4": "m", "0.05": "m/s", "0.2": "s", "1e-10": "m", "100": "N"}
_BASE = {
    "kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "N": (1, 1, -2), "J": (1, 2, -2), "Hz": (0, 0, -1),
    "1": (0, 0, 0),
}  # fmt: skip


def members(*kinds):
    return [member for member in CATALOGUE.values() if member.kind in kinds]


def name_of(member: Member) -> str:
    return member.name


def evaluated(text: str, names: dict) -> dict:
    """All parts of an equation; an equation that is one expression gives ``F``."""
    values = dict(names)
    for part in (text if " = " in text else f"F = {text}").split("; "):
        name, _, expression = part.partition(" = ")
        values[name] = eval(expression, {"__builtins__": {}}, {**_WORDS, **values})  # the catalogue's own
    return values


def compiled(effect, t, x, v, T, k, c, states=()):
    """Force [N] and state rates of an effect's machine code."""
    s, rates, rate = (c_double * 8)(*states), (c_double * 8)(), (c_double * 1)()
    p = (c_double * (len(effect.values) + 1))(*effect.values)
    force = _KERNEL(effect.address)(t, x, v, T, k, c, s, p, rates, rate)
    return force, list(rates)[: effect.states], rate[0]


def drawn(member: Member, rng, share=0.5, ground=False):
    """Parameters drawn about the defaults, within bounds."""
    kind = next((place for place in member.places if place != "ground"), "ground")
    numbers = member.at(kind, ground=ground).parameters
    return {
        name: float(np.clip(p.value * (1 + share * rng.uniform(-1, 1)), *p.bounds)) if p.value else 0.0
        for name, p in numbers.items()
    }


def motion(rng, samples=4000, amplitude=1e-4, frequency=16.0, periods=2):
    """A closed motion from and to zero: time, displacement, velocity at half steps, and the step."""
    step = periods / frequency / samples
    t = 0.5 * step * np.arange(2 * samples + 1)
    x, v = np.zeros_like(t), np.zeros_like(t)
    for harmonic in range(1, 5):
        w, phase = 2 * np.pi * frequency * harmonic, rng.uniform(0, 2 * np.pi)
        a = amplitude * rng.normal() / harmonic
        x += a * (np.sin(w * t + phase) - np.sin(phase))
        v += a * w * np.cos(w * t + phase)
    return t, x, v, step


def driven(function, p, states, path, T=150.0, k=9e5, c=100.0):
    """Force at the full steps of a prescribed motion, states by the classical Runge-Kutta method."""
    t, x, v, step = path

    def slope(i, s):
        ds = [0.0] * states
        force = function(t[i], x[i], v[i], T, k, c, s, p, ds, [0.0])
        return force, np.array(ds)

    s, forces = np.zeros(states), []
    for i in range(0, len(t) - 1, 2):
        force, k1 = slope(i, s)
        forces.append(force)
        k2 = slope(i + 1, s + 0.5 * step * k1)[1]
        k3 = slope(i + 1, s + 0.5 * step * k2)[1]
        k4 = slope(i + 2, s + step * k3)[1]
        s = s + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array([*forces, slope(len(t) - 1, s)[0]])


def scale_of(unit: str, base=(1.7, 2.3, 0.6)) -> float:
    """How the number of a quantity changes where units of mass, length and time do."""
    above, _, below = unit.partition("/")
    powers = np.zeros(3)
    for sign, part in ((1, above), (-1, below)):
        for token in part.split():
            word, power = re.fullmatch(r"([A-Za-z]+|1)(\d*)", token).groups()
            powers += sign * int(power or 1) * np.array(_BASE[word])
    return float(prod(b**power for b, power in zip(base, powers, strict=True)))


def rescaled(text: str) -> str:
    """An equation whose numbers with a unit are those of the other units."""
    for literal, unit in _LITERALS.items():
        text = re.sub(rf"(?<![\w.]){re.escape(literal)}(?![\w.])", f"({literal} * {scale_of(unit)!r})", text)
    return text
