"""The forces that a model leaves unbalanced along a measured motion, whitened by the sensors' noise.

    r = (F - sum_k C_k theta_k - sum_e f_e(x, v, T)) / sigma

Rows are those of the equation error (`rom.identification.equation_error`): F measured forces, C what the
free numbers theta of the model multiply, f the forces of its effects, sigma what white sensor noise makes of
a row.
Driven bodies, free decays beside them, and links that are cycled on their own have this residual.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.residual.base import Kind, ProjectedResidual, cost
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import Effect, ModelCorrection, SensorFault
from rom.identification.equation_error import noise_freedom
from rom.identification.force_balance import Balances

_STEP: Numerical[float] = 1e-3  # of a stiffness
_CARRIED: Numerical[float] = 0.01  # of the change of the spring's own force
_STIFFNESS = re.compile(r"\bk\b")


def sees_stiffness(effect: ModelCorrection) -> bool:
    """Whether an effect's equation holds the stiffness of its link."""
    return _STIFFNESS.search(effect.equation) is not None


@dataclass(frozen=True, eq=False)
class ForceBalanceResidual(ProjectedResidual):
    """Balances of forces, the effects of the model so far, and its numbers by path.

    Attributes
    ----------
    balances : Balances
        Measured forces and what balances them, as rows.
    effects : tuple of ModelCorrection
        Forces, and faults of force sensors.
    values : mapping of str to float
        The model's numbers [SI] by the names of `balances`.
    """

    kind: ClassVar[Kind] = "force balance"
    balances: Balances
    effects: tuple[ModelCorrection, ...]
    values: Mapping[str, float]
    criteria: Criteria = CRITERIA

    @property
    def noise_freedom(self) -> float:
        """Degrees of freedom of the noise of the training rows."""
        told = [one.motion.values() for one in self.balances.records if not one.settings.hold_out]
        return sum(noise_freedom(motion.shape[1]) for motions in told for motion in motions)

    def constants(self, enters: str) -> tuple[float, float]:
        """Stiffness [N/m] and damping [N s/m] of a link; zero of a body."""
        return self.values.get(f"{enters}.stiffness.k", 0.0), self.values.get(f"{enters}.damping.c", 0.0)

    def shares_stiffness(self, link: str) -> bool:
        """Whether an effect that the model has already sees the stiffness of a link."""
        return any(effect.enters == link and sees_stiffness(effect) for effect in self.effects)

    @cached_property
    def carried_stiffnesses(self) -> tuple[str, ...]:
        """Names of the stiffnesses that the effects' forces go with, not those that only limit them."""
        return tuple(name for name in self.balances.names if self._is_carried(name))

    def _is_carried(self, name: str) -> bool:
        link, whole = name.removesuffix(".stiffness.k"), self.values[name]
        if link == name or not self.shares_stiffness(link):
            return False
        moved = replace(self, values={**self.values, name: whole + _STEP * max(whole, 1e-12)})
        step = moved.values[name] - whole
        changes = [
            moved.force_of(effect, training=True) - self.force_of(effect, training=True)
            for effect in self.effects
            if effect.enters == link
        ]
        column = self.balances.columns[self.training, self.balances.names.index(name)]
        return bool(np.linalg.norm(sum(changes)) > _CARRIED * step * np.linalg.norm(column))

    def own_stiffness(self, effect: ModelCorrection) -> bool:
        """Whether the stiffness that a new effect sees is fitted beside it."""
        known = f"{effect.enters}.stiffness.k" in self.balances.names
        return known and sees_stiffness(effect) and not self.shares_stiffness(effect.enters)

    def force_of(self, effect: ModelCorrection, *, training: bool = False) -> FloatArray:
        """Rows of an effect's force [N], (rows,); of a sensor's fault what it adds to the measured force."""
        if isinstance(effect, SensorFault):
            return self._of_fault(effect)
        assert isinstance(effect, Effect)
        return self.balances.of(effect, *self.constants(effect.enters), training=training)

    def _of_fault(self, fault: SensorFault) -> FloatArray:
        """What a fault adds to the force that the model has; along the measured one a gain would mend all."""
        forces = [self.force_of(effect) for effect in self.effects if isinstance(effect, Effect)]
        modelled = self.balances.balanced(self.values) + sum(forces, np.zeros(1))
        shown = [
            fault.apply(rows, rate) - rows if channel == fault.channel else np.zeros(len(rows))
            for rows, channel, rate in self.balances.by_channel(modelled)
        ]
        return np.concatenate(shown)

    @cached_property
    def force(self) -> FloatArray:
        """Measured forces less those of the effects [N], (rows,)."""
        total = sum((self.force_of(effect) for effect in self.effects), np.zeros(1))
        return np.asarray(self.balances.force - total)

    @cached_property
    def residual(self) -> FloatArray:
        """What is left unbalanced, over the noise, (rows,)."""
        names = self.balances.names
        numbers = np.array([self.values[name] for name in names])
        return np.asarray((self.force - self.balances.columns @ numbers) / self.balances.noise)

    @property
    def owner(self) -> npt.NDArray[np.int64]:
        """Place of each row's record, (rows,)."""
        return self.balances.owner

    @property
    def held_out(self) -> list[tuple[str, bool]]:
        """File of each record, and whether no number may be fitted to it."""
        return [(record.settings.file, record.settings.hold_out) for record in self.balances.records]

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal basis of the whitened columns of the model's numbers, (training rows, numbers)."""
        rows = self.training
        scaled = self.balances.columns[rows] / self.balances.noise[rows, None]
        return np.asarray(np.linalg.qr(scaled)[0])

    def whitened(self, force: FloatArray) -> FloatArray:
        """Rows of a force [N] over the noise, (rows,)."""
        return np.asarray(force / self.balances.noise)

    def with_numbers(self) -> ForceBalanceResidual:
        """The same with the numbers that suit the training rows best.

        Forces of effects may go with a stiffness that they see: it is held where less is left then.
        """
        seen = {
            name: self.values[name] for name in self.balances.names
            if self.shares_stiffness(name.removesuffix(".stiffness.k"))
        }  # fmt: skip
        fits = [self._with_others(held) for held in ({}, seen)] if seen else [self._with_others({})]
        return min(fits, key=cost)

    def _with_others(self, held: Mapping[str, float]) -> ForceBalanceResidual:
        names, found = self.balances.names, self.balances.fitted(self.force, held)[0]
        return replace(self, values={**self.values, **dict(zip(names, found.tolist(), strict=True))})

    def force_error(self) -> float:
        """Norm of the unbalanced force [N] on hold-out records, or on all where none is held out."""
        rows = ~self.training if not self.training.all() else self.training
        return float(np.linalg.norm((self.residual * self.balances.noise)[rows]))
