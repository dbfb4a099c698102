"""What single modes show of a record in its channels: responses to its forces, and decays from its start.

    q'' + 2 zeta omega q' + omega^2 q = F,    F linear between its samples,

solved exactly by its pole: w' = lambda w + F, q = 2 Re(w / (lambda - conj lambda)). F is sharpened for
straight lines (`rom.signals.filters`); an accelerometer shows the force as it was sampled at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import signal

from rom.campaign.channels import FloatArray
from rom.identification.ring_down import RingDown
from rom.model.shapes import derived

ComplexArray = npt.NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class ModalRecord:
    """A record as its modes are fitted to it: its rows over their noise, and the forces of all places."""

    ring: RingDown
    forces: tuple[str, ...]

    @property
    def whitened(self) -> FloatArray:
        """Rows over their noise, (channels, rows)."""
        return self.ring.measured / self.ring.noise[:, None]

    @property
    def kinds(self) -> tuple[str, ...]:
        """Quantity of each channel."""
        return self.ring.kinds

    def force(self, place: str) -> FloatArray:
        """Force at a place [N], (samples,); zero where none was measured."""
        seen = self.ring.measurement
        return seen.applied_force.get(place, np.zeros(seen.samples))

    def at_once(self) -> FloatArray:
        """What follows the force at each place at once, over the noise, (channels, places, rows)."""
        rate = self.ring.measurement.rate_hz
        found = {
            kind: [self.ring.compared(kind, derived(self.force(p), kind, rate)) for p in self.forces]
            for kind in set(self.kinds)
        }
        size = (len(self.forces), self.ring.measured.shape[1])
        return self._by_channel({kind: np.reshape(rows, size) for kind, rows in found.items()})

    def of_modes(
        self,
        omega: Sequence[float] | FloatArray,
        ratio: Sequence[float] | FloatArray,
        *,
        quadrature: bool = False,
    ) -> FloatArray:
        """What modes of 1 kg show, over the noise: (channels, modes, places + 2, rows).

        By the force at each place, then as decays from the first sample, cosine and sine.

        Parameters
        ----------
        omega : sequence of float
            Circular frequencies [rad/s].
        ratio : sequence of float
            Damping ratios.
        quadrature : bool
            Whether the response to each force is followed by that of a residue turned by 90 degrees.
        """
        found: dict[str, list[FloatArray]] = {kind: [] for kind in self.kinds}
        for one in zip(omega, ratio, strict=True):
            motions = self._motions(*one, quadrature=quadrature)
            for kind in found:
                found[kind].append(self.ring.compared(kind, motions[kind]))
        return self._by_channel({kind: np.stack(rows) for kind, rows in found.items()})

    def _by_channel(self, of_kind: dict[str, FloatArray]) -> FloatArray:
        rows = [of_kind[kind] / n for kind, n in zip(self.kinds, self.ring.noise.tolist(), strict=True)]
        return np.stack(rows)

    def _motions(self, omega: float, ratio: float, *, quadrature: bool) -> dict[str, FloatArray]:
        """Displacement, velocity and acceleration of one mode, (places + 2 or 2 places + 2, samples)."""
        seen = self.ring.measurement
        pole, step = complex(-ratio, np.sqrt(1 - ratio**2)) * omega, 1 / seen.rate_hz
        scale = 2 / (2j * pole.imag)
        turned = np.exp(pole * step)
        ahead = (turned - 1 - pole * step) / (pole**2 * step)
        forces = [self.force(place) for place in self.forces]
        free = np.exp(pole * step * np.arange(seen.samples))
        rows = [
            signal.lfilter([ahead, (turned - 1) / pole - ahead], [1, -turned], f, zi=[-ahead * f[0] + 0j])[0]
            for f in forces
        ]
        sampled = [seen.force.get(place, np.zeros(seen.samples)) for place in self.forces]
        acting = np.stack([*sampled, *np.zeros((2, seen.samples))])
        if quadrature:
            rows = [turn * row for row in rows for turn in (1.0, 1j)]
            at_once = (1.0, -ratio / np.sqrt(1 - ratio**2))
            acting = np.stack([*(f * share for f in sampled for share in at_once), *acting[-2:]])
        own = pole.imag / omega**2 if "acceleration" in self.kinds else pole.imag
        states = scale * np.stack([*rows, 1j * own * free, own * free])
        return {
            "displacement": states.real,
            "velocity": (pole * states).real,
            "acceleration": (pole**2 * states).real + acting,
        }
