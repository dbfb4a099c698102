"""The balance of momentum of a hit or of a driven record, kept small: what tells a unit, a sign, a delay.

``F = sum m_i a_i + c_i v_i + k_i x_i`` over all bodies, whatever happens between them; c_i and k_i, none
below zero, tie bodies to the ground. Only products of its columns are kept, from which the misfit of any
masses, of channels exchanged or rescaled, follows without the record.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import optimize

from rom.campaign.campaign import CampaignSettings, Record
from rom.campaign.channels import MOTIONS, Channel, FloatArray
from rom.campaign.settings import GROUND
from rom.criteria.number import Numerical
from rom.criteria.suspicions import Suspicions
from rom.signals.damage import white_noise
from rom.signals.delays import Window, begins, free_masses, least, noise_share, products, ties_of
from rom.signals.hits import Hit

_KEPT: Numerical[float] = 0.03  # weight of gains of one, in the force: far below what noise leaves of it


@dataclass(frozen=True, eq=False)
class Balance:
    """What force did to the bodies that move: `root` holds the products of force and motions.

    Attributes
    ----------
    channels : tuple of str
        Motion of each body that moves, in the order of `bodies`.
    root : ndarray, shape (1 + 3 n, 1 + 3 n)
        Triangular root of the products of force, accelerations, velocities, displacements, trends taken out.
    late_s, late_misfit : float
        Delay behind the force that balances best [s], and what it leaves of the misfit without it.
    late : tuple of str
        The motions with that delay.
    peak_n : float
        Largest force [N].
    noise : ndarray, shape (1 + n,)
        Squares of white noise in the columns of force and accelerations.
    parts : int
        Of the record, that are balanced each: one hit, many of a driven record.
    rules : Suspicions
        The numbers that decide.
    """

    bodies: tuple[str, ...]
    grounded: tuple[bool, ...]
    channels: tuple[str, ...]
    force: str
    peak_n: float
    root: FloatArray
    noise: FloatArray
    rules: Suspicions
    late_s: float = 0.0
    late_misfit: float = 1.0
    late: tuple[str, ...] = ()
    parts: int = 1

    def misfit(self, masses: Sequence[float] | FloatArray, channels: Sequence[int] | None = None) -> float:
        """Return what is left of the force, as a share of its square.

        Parameters
        ----------
        masses : array_like, shape (n,)
            Of each body [kg], negative for a channel of the wrong sign.
        channels : sequence of int, shape (n,)
            Place of the channel that shows each body; None for its own.
        """
        order = np.arange(len(self.bodies)) if channels is None else np.asarray(channels)
        return _misfit(self.root, np.asarray(masses, float), order, self.grounded)

    def shows(self, masses: FloatArray) -> bool:
        """Whether the masses that balance best are these, but for what sensors may do."""
        low, high = _gains(masses, self.rules.scale_factor, self.rules.crossed)
        return bool(np.all((self.masses > low * masses) & (self.masses < high * masses)))

    def misfit_of_noise(self, masses: FloatArray) -> float:
        """Return what white noise of the channels leaves of the force, as a share of its square."""
        return noise_share(self.root, self.noise, masses)

    def with_gains(
        self,
        masses: FloatArray,
        largest: float,
        channels: Sequence[int] | None = None,
        crossed: float = 0.0,
    ) -> tuple[float, FloatArray]:
        """Return what is left of the force, as a share of its square, and the gain of each body's sensor.

        Parameters
        ----------
        masses : ndarray, shape (n,)
            Of each body [kg], negative for a channel of the wrong sign.
        largest : float
            Largest gain that a sensor may have, and one over the smallest.
        channels : sequence of int, shape (n,)
            Place of the channel that shows each body; None for its own.
        crossed : float
            Largest share of another body's motion that a sensor may show.

        A sensor may be late or early as well, which looks like damping of either sign.
        """
        count, signs = len(masses), np.sign(masses)
        order = np.arange(count) if channels is None else np.asarray(channels)
        places = np.concatenate([[0], *(1 + part * count + order for part in range(3))])
        root, scale = self.root[:, places], float(np.linalg.norm(self.root[:, 0]))
        ties = ties_of(root, self.grounded, signs)
        ties /= np.maximum(np.linalg.norm(ties, axis=0), 1e-300)
        # what balances whatever the gain keeps a gain of one
        weights = _KEPT * scale * np.abs(masses) / max(float(np.abs(masses).max()), 1e-300)
        kept = np.hstack([np.diag(weights), np.zeros((count, ties.shape[1]))])
        columns = np.vstack([np.hstack([root[:, 1 : 1 + count] * masses, ties]), kept])
        rest = np.concatenate([root[:, 0], weights])
        low, high = np.zeros(columns.shape[1]), np.full(columns.shape[1], np.inf)
        low[:count], high[:count] = _gains(masses, largest, crossed)
        low[count : count + sum(self.grounded)] = -np.inf
        found = optimize.lsq_linear(columns, rest, (low, high), method="bvls").x
        left = rest[: len(root)] - columns[: len(root)] @ found
        return float(left @ left) / max(scale**2, 1e-300), np.asarray(found[:count])

    @cached_property
    def masses(self) -> FloatArray:
        """Masses that balance best [kg], none below zero."""
        return free_masses(self.root, self.grounded)[0]

    def masses_turned(self, bodies: Collection[str]) -> FloatArray:
        """Masses that balance best with the signs of some bodies' motions turned [kg], none below zero."""
        signs = np.where(np.isin(self.bodies, list(bodies)), -1.0, 1.0)
        return free_masses(self.root * np.concatenate([[1.0], signs, signs, signs]), self.grounded)[0]


def hit_balance(record: Record, settings: CampaignSettings, hit: Hit, rules: Suspicions) -> Balance | None:
    """Return the balance of a record's hit; None where force and motions are not sampled together.

    Parameters
    ----------
    record : Record
        The record.
    settings : CampaignSettings
        For the links to the ground.
    hit : Hit
        Its hit.
    rules : Suspicions
        The numbers that decide.
    """
    rate, motions = hit.force.rate_hz, _Motions.of(record, settings)
    if not motions.sampled_at(rate):
        return None
    contact = (hit.stop - hit.start) / rate  # of a small structure it is short, and all that follows
    window_s, guard_s, latest_s = (
        min(seconds, rules.balance_contacts * contact * seconds / rules.balance_window_s)
        for seconds in (rules.balance_window_s, rules.balance_guard_s, rules.latest_s)
    )
    first = max(hit.start - round(guard_s * rate), 0)
    last = min(hit.stop + round(window_s * rate), *map(len, motions.rows))
    quiet = [samples[: hit.start] for samples in (hit.force.samples, *motions.rows)]
    noise = (last - first) * motions.noise(quiet, rules)
    step = max((hit.stop - hit.start) // 6, 1)
    window = Window(
        hit.force.samples, motions.rows, (first, last), motions.order, motions.orders, rate,
        motions.grounded, noise, step, rules,
    )  # fmt: skip
    first_motion = min(map(begins, motions.rows)) - hit.start
    delay = window.delay(round(latest_s * rate), first_motion, rules.late_s * rate)
    return Balance(
        bodies=record.bodies,
        grounded=motions.grounded,
        channels=motions.names,
        force=hit.force.name,
        peak_n=float(np.abs(hit.pulse).max()),
        root=delay.root,
        late_s=delay.samples / rate,
        late_misfit=delay.misfit,
        late=tuple(motions.names[place] for place in delay.places),
        noise=noise,
        rules=rules,
    )


def driven_balance(record: Record, settings: CampaignSettings, rules: Suspicions) -> Balance | None:
    """Return the balance of a driven record, in parts; None where it shows no force sampled with all motions.

    Parameters
    ----------
    record : Record
        The record.
    settings : CampaignSettings
        For the links to the ground.
    rules : Suspicions
        The numbers that decide.
    """
    motions = _Motions.of(record, settings)
    forces = [force for body in record.bodies if (force := record.force(body)) is not None]
    if record.relative or not forces or not all(motions.sampled_at(force.rate_hz) for force in forces):
        return None
    total, rate = np.sum([force.samples for force in forces], axis=0), forces[0].rate_hz
    size = len(total) // rules.balance_parts
    if size < rules.shortest_part:
        return None
    parts = [slice(i * size, (i + 1) * size) for i in range(rules.balance_parts)]
    roots = [
        products(total[part], [row[part] for row in motions.rows], motions.order, motions.orders, rate)
        for part in parts
    ]
    root = np.asarray(np.linalg.qr(np.vstack(roots), mode="r"))
    if not root[:, 0].any():
        return None
    return Balance(
        bodies=record.bodies,
        grounded=motions.grounded,
        channels=motions.names,
        force=forces[0].name,
        peak_n=float(np.abs(total).max()),
        root=root,
        noise=len(total) * motions.noise([total, *motions.rows], rules),
        parts=len(parts),
        rules=rules,
    )


@dataclass(frozen=True, eq=False)
class _Motions:
    """Channels of a record's bodies; how often force and each is integrated; which bodies are grounded."""

    channels: tuple[Channel, ...]
    order: int
    orders: tuple[int, ...]
    grounded: tuple[bool, ...]

    @classmethod
    def of(cls, record: Record, settings: CampaignSettings) -> _Motions:
        motions = [record.motion(body) for body in record.bodies]
        kinds = [MOTIONS.index(kind) for kind, _ in motions]
        order = max(kinds, default=0)
        grounded = tuple(
            any(GROUND in link.between and body in link.between for link in settings.link)
            for body in record.bodies
        )
        orders = tuple(order - kind for kind in kinds)
        return cls(tuple(channel for _, channel in motions), order, orders, grounded)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(channel.name for channel in self.channels)

    @property
    def rows(self) -> list[FloatArray]:
        return [channel.samples for channel in self.channels]

    def sampled_at(self, rate_hz: float) -> bool:
        return bool(self.channels) and all(channel.rate_hz == rate_hz for channel in self.channels)

    def noise(self, quiet: Sequence[FloatArray], rules: Suspicions) -> FloatArray:
        """Square of white noise of force and accelerations at a sample; zero where too few tell it."""
        measured = (self.order == 0, *(times == 0 for times in self.orders))
        return np.array(
            [
                white_noise(samples) ** 2 if told and len(samples) >= rules.shortest else 0.0
                for samples, told in zip(quiet, measured, strict=True)
            ]
        )


def _gains(masses: FloatArray, largest: float, crossed: float) -> tuple[FloatArray, FloatArray]:
    """Return the least and the largest gain of each body's sensor; a light one shows more of the others."""
    seen = crossed * np.max(np.abs(masses)) / np.maximum(np.abs(masses), 1e-300)
    return 1 / largest - seen, largest + seen


def _misfit(root: FloatArray, masses: FloatArray, order: np.ndarray, grounded: Sequence[bool]) -> float:
    count = len(masses)
    places = np.concatenate([[0], *(1 + part * count + order for part in range(3))])
    columns = root[:, places]
    rest = columns[:, 0] - columns[:, 1 : 1 + count] @ masses
    ties = ties_of(columns, grounded, np.sign(masses))
    left = float(np.linalg.norm(rest)) if ties.shape[1] == 0 else least(ties, rest)[1]
    return left**2 / max(float(columns[:, 0] @ columns[:, 0]), 1e-300)
