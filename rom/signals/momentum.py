"""The balance of momentum of one hit, kept small: what tells a unit, an exchange, a sign or a delay.

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
from rom.signals.delays import Window, begins, free_masses, least, noise_share, ties_of
from rom.signals.hits import Hit

_KEPT: Numerical[float] = 0.03  # weight of gains of one, in the force: far below what noise leaves of it


@dataclass(frozen=True, eq=False)
class HitBalance:
    """What one hit did to the bodies that move: `root` holds the products of force and motions.

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
        Largest force of the contact [N].
    noise : ndarray, shape (1 + n,)
        Squares of white noise in the columns of force and accelerations.
    rules : Suspicions
        The numbers that decide.
    """

    bodies: tuple[str, ...]
    grounded: tuple[bool, ...]
    channels: tuple[str, ...]
    force: str
    peak_n: float
    root: FloatArray
    late_s: float
    late_misfit: float
    late: tuple[str, ...]
    noise: FloatArray
    rules: Suspicions

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
        least, most = _gains(masses, self.rules.scale_factor, self.rules.crossed)
        return bool(np.all((self.masses > least * masses) & (self.masses < most * masses)))

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
        least, most = np.zeros(columns.shape[1]), np.full(columns.shape[1], np.inf)
        least[:count], most[:count] = _gains(masses, largest, crossed)
        least[count : count + sum(self.grounded)] = -np.inf
        found = optimize.lsq_linear(columns, rest, (least, most), method="bvls").x
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


def hit_balance(record: Record, settings: CampaignSettings, hit: Hit, rules: Suspicions) -> HitBalance | None:
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
    motions = [record.motion(body) for body in record.bodies]
    rate = hit.force.rate_hz
    if not motions or any(channel.rate_hz != rate for _, channel in motions):
        return None
    contact = (hit.stop - hit.start) / rate  # of a small structure it is short, and all that follows
    window_s, guard_s, latest_s = (
        min(seconds, rules.balance_contacts * contact * seconds / rules.balance_window_s)
        for seconds in (rules.balance_window_s, rules.balance_guard_s, rules.latest_s)
    )
    first = max(hit.start - round(guard_s * rate), 0)
    last = min(hit.stop + round(window_s * rate), *(len(channel.samples) for _, channel in motions))
    grounded = tuple(
        any(GROUND in link.between and body in link.between for link in settings.link)
        for body in record.bodies
    )
    order = max(MOTIONS.index(kind) for kind, _ in motions)
    orders = [order - MOTIONS.index(kind) for kind, _ in motions]
    rows = [channel.samples for _, channel in motions]
    noise = (last - first) * np.array(
        [_noise_before(hit.force, hit, rules) ** 2 * (order == 0)]
        + [
            _noise_before(channel, hit, rules) ** 2 * (times == 0)
            for (_, channel), times in zip(motions, orders, strict=True)
        ]
    )
    step = max((hit.stop - hit.start) // 6, 1)
    window = Window(hit.force.samples, rows, (first, last), order, orders, rate, grounded, noise, step, rules)
    first_motion = min(map(begins, rows)) - hit.start
    delay = window.delay(round(latest_s * rate), first_motion, rules.late_s * rate)
    names = tuple(channel.name for _, channel in motions)
    return HitBalance(
        bodies=record.bodies,
        grounded=grounded,
        channels=names,
        force=hit.force.name,
        peak_n=float(np.abs(hit.pulse).max()),
        root=delay.root,
        late_s=delay.samples / rate,
        late_misfit=delay.misfit,
        late=tuple(names[place] for place in delay.places),
        noise=noise,
        rules=rules,
    )


def _gains(masses: FloatArray, largest: float, crossed: float) -> tuple[FloatArray, FloatArray]:
    """Return the least and the largest gain of each body's sensor; a light one shows more of the others."""
    seen = crossed * np.max(np.abs(masses)) / np.maximum(np.abs(masses), 1e-300)
    return 1 / largest - seen, largest + seen


def _noise_before(channel: Channel, hit: Hit, rules: Suspicions) -> float:
    """White noise of a channel before the hit, zero where too few samples tell it."""
    return white_noise(channel.samples[: hit.start]) if hit.start >= rules.shortest else 0.0


def _misfit(root: FloatArray, masses: FloatArray, order: np.ndarray, grounded: Sequence[bool]) -> float:
    count = len(masses)
    places = np.concatenate([[0], *(1 + part * count + order for part in range(3))])
    columns = root[:, places]
    rest = columns[:, 0] - columns[:, 1 : 1 + count] @ masses
    ties = ties_of(columns, grounded, np.sign(masses))
    left = float(np.linalg.norm(rest)) if ties.shape[1] == 0 else least(ties, rest)[1]
    return left**2 / max(float(columns[:, 0] @ columns[:, 0]), 1e-300)
