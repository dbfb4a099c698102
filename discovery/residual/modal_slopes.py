"""Slopes by numbers that change what sensors show, and not how modal bodies move: no simulation is needed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rom.campaign.channels import FloatArray
from rom.identification.ring_down import RingDown
from rom.model.model import Model
from rom.model.shapes import ModeShapes, compliance_path, shape_path


class ModalSlopes:
    """Of records from their states: slopes of all rows by a shape or a compliance.

    Parameters
    ----------
    rings : sequence of RingDown
        Training records.
    model : Model
        Of modes, or without shapes: then there is nothing to tell.
    states : sequence of ndarray
        State of each record, (2 bodies,).
    """

    def __init__(self, rings: Sequence[RingDown], model: Model, states: Sequence[FloatArray]) -> None:
        self._rings = rings
        self._found: dict[str, list[FloatArray]] = {}
        if model.shapes is not None:
            for ring, state in zip(rings, states, strict=True):
                self._add(ring, model, model.shapes, state)

    def of(self, path: str) -> FloatArray | None:
        """Slopes by a number, (rows of all records,); None where it moves the bodies too."""
        rows = self._found.get(path)
        return None if rows is None else np.concatenate(rows)

    def _add(self, ring: RingDown, model: Model, shapes: ModeShapes, state: FloatArray) -> None:
        motion = ring.modal.of_modes(model, state, ring.tolerance)
        still = np.zeros((len(shapes.modes), ring.measured.shape[1]))
        for kind in dict.fromkeys(ring.kinds):
            moved = still if motion is None else motion[kind]
            sensors = [s for s, own in enumerate(ring.kinds) if own == kind]
            for s in sensors:
                place = ring.channels[s]
                for mode, rows in zip(shapes.modes, moved, strict=True):
                    if place not in shapes.forces:
                        self._put(ring, shape_path(mode, place), s, rows)
                for force in shapes.forces:
                    followed = ring.modal.followed[kind].get(force, still[0])
                    self._put(ring, compliance_path(place, force), s, followed)

    def _put(self, ring: RingDown, path: str, channel: int, rows: FloatArray) -> None:
        table = np.zeros(ring.measured.shape)
        table[channel] = rows / ring.noise[channel]
        self._found.setdefault(path, []).append(ring.white(table))
