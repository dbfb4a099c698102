"""Measured channels: a sampled signal, and the names that say what it holds."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]

Motion: TypeAlias = Literal["acceleration", "velocity", "displacement"]
MOTIONS: tuple[Motion, ...] = ("acceleration", "velocity", "displacement")
BODY_QUANTITIES = ("force", *MOTIONS)
LINK_QUANTITIES = ("link_displacement", "link_force", "normal_force")
BOLT_CHANNELS = ("tension", "strain")
GROUND_CHANNELS = ("acceleration_ground", "displacement_ground")
SMALLEST, LARGEST = 1e-40, 1e40
"""Between these are all numbers of a campaign: their fourth powers and products are numbers too."""
MOST_CHOICES = 8  # more names in one line of a message help nobody


@dataclass(frozen=True, eq=False)
class Channel:
    """One measured signal: `samples` (1-D, SI units), evenly spaced at `rate_hz` [Hz] from time 0.

    Raises
    ------
    ValueError
        If `samples` is not a one-dimensional array or `rate_hz` is not a positive number.
    """

    name: str
    samples: FloatArray
    rate_hz: float

    def __post_init__(self) -> None:
        if np.ndim(self.samples) != 1:
            shape = np.shape(self.samples)
            raise ValueError(f"{self.name}: samples must be one-dimensional, instead got shape {shape}")
        if not (np.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ValueError(f"{self.name}: rate_hz must be above 0, instead got {self.rate_hz}")

    @property
    def duration_s(self) -> float:
        """Length of the signal [s]: number of samples over rate."""
        return len(self.samples) / self.rate_hz

    @property
    def time(self) -> FloatArray:
        """Time of each sample [s], from 0 at the record's start."""
        return np.arange(len(self.samples)) / self.rate_hz


def channel_names(bodies: Iterable[str], links: Iterable[str]) -> tuple[str, ...]:
    """Every channel name that a campaign with these bodies and links may use."""
    of_bodies = [f"{quantity}_{body}" for body in bodies for quantity in BODY_QUANTITIES]
    of_links = [f"{quantity}_{link}" for link in links for quantity in LINK_QUANTITIES]
    return (*of_bodies, *of_links, *BOLT_CHANNELS, *GROUND_CHANNELS)


def motion_channels(body: str) -> tuple[str, ...]:
    """Names of the channels that give the motion of `body`, the usual sensor first."""
    return tuple(f"{motion}_{body}" for motion in MOTIONS)


def default_rate(channel: str, motion_rate_hz: float, tension_rate_hz: float) -> float:
    """Sampling rate [Hz] of a channel whose file does not state one.

    Parameters
    ----------
    channel : str
        Name of the channel.
    motion_rate_hz : float
        Rate of motions and forces [Hz].
    tension_rate_hz : float
        Rate of the bolt's channel [Hz].

    Returns
    -------
    float
        Rate [Hz].
    """
    return tension_rate_hz if channel in BOLT_CHANNELS else motion_rate_hz


def nearest(word: str, choices: Iterable[str]) -> str | None:
    """Return the choice that `word` most likely misspells, or None if nothing is close."""
    by_lower_case = {choice.lower(): choice for choice in choices}
    close = difflib.get_close_matches(word.lower(), by_lower_case, n=1, cutoff=0.6)
    return by_lower_case[close[0]] if close else None


def one_of(word: str, choices: Iterable[str]) -> str:
    """Words for "expected ...": the choices, and the nearest one where `word` looks like a slip."""
    choices = tuple(choices)
    guess = nearest(word, choices)
    if guess is not None:
        return f'"{guess}" (nearest known name)'
    if not choices:
        return "none here"
    listed = ", ".join(f'"{choice}"' for choice in choices[:MOST_CHOICES])
    return f"one of {listed}{', ...' if len(choices) > MOST_CHOICES else ''}"
