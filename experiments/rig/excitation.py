"""What sets the rig in motion: the hammer and the floor."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

STEP_RATE_HZ = 76_800.0
"""Steps per second: four for every sample of force and acceleration, sixteen for every one of strain."""

FLOOR_RATE_HZ = 600.0
"""Rate of the knots between which the floor moves along cubics [Hz]; its motion ends at 30 Hz."""


def contact_time(strength: float) -> float:
    """Return the length of a hammer pulse [s]: 1.05 ms at 28 N, 0.65 ms at 1600 N.

    Equation: ``tau = 1.05e-3 (F / 28)^-0.118``. Harder hits meet a stiffer tip.
    """
    return float(1.05e-3 * (strength / 28.0) ** -0.118)


@dataclass(frozen=True)
class Hit:
    """Half-sine blow ``F(t) = strength sin(pi (t - start) / duration)`` on one body.

    Attributes
    ----------
    body : str
        ``"lo"`` or ``"so"``.
    strength : float
        Peak force [N].
    start, duration : float
        First contact and length of contact [s].
    """

    body: str
    strength: float
    start: float
    duration: float

    def force(self, time: FloatArray) -> FloatArray:
        """Return the force [N] at increasing times [s]."""
        force = np.zeros_like(time)
        inside = slice(*np.searchsorted(time, [self.start, self.start + self.duration]))
        force[inside] = self.strength * np.sin(np.pi * (time[inside] - self.start) / self.duration)
        return force


def floor_motion(rms: float, start: float, end: float, rng: np.random.Generator) -> FloatArray:
    """Return displacement [m] and velocity [m/s] of the floor at knots, shape (2, knots).

    Noise between 2 and 30 Hz whose displacement spectrum falls with the square of frequency, as floors do.
    Knots lie at `FLOOR_RATE_HZ` from `start` to at least `end` [s].

    Parameters
    ----------
    rms : float
        Of the displacement [m].
    start, end : float
        Times between which it is needed [s].
    rng : numpy.random.Generator
        Source of the noise.

    Returns
    -------
    ndarray, shape (2, knots)
        Displacement [m] and velocity [m/s].
    """
    knots = int(np.ceil((end - start) * FLOOR_RATE_HZ)) + 2
    frequency = np.fft.rfftfreq(knots, 1.0 / FLOOR_RATE_HZ)
    band = (frequency >= 2.0) & (frequency <= 30.0)
    amplitude = np.where(band, 1.0 / np.maximum(frequency, 1.0) ** 2, 0.0)
    spectrum = amplitude * (rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size))
    spectrum *= rms * knots / (2.0 * np.sqrt(np.sum(amplitude**2)))
    velocity = spectrum * 2j * np.pi * frequency
    return np.stack([np.fft.irfft(spectrum, knots), np.fft.irfft(velocity, knots)])
