"""The declared model of a campaign that drives its bodies or links: masses, springs, dashpots, offsets.

By least squares on the balances of forces (``rom.identification.equation_error``), in which all of them are
linear:

    F = M x'' + sum (k x + c x') - F_0

with F_0 the constant force that an amplifier's offset, a tilted guide or the zero of a force sensor makes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from scipy import optimize

from rom.campaign.campaign import Campaign, CampaignSettings, Record, RecordSettings
from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.effects import CATALOGUE, Effect
from rom.identification.equation_error import TESTS, Balance, ForceRecord, force_records
from rom.model.description import LinkLaws
from rom.model.laws import Z95, Law, Parameter, constant_damping, constant_stiffness
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure
from rom.signals.measured_records import measured_record
from rom.signals.quality import Doubt

OFFSET = "constant-force"
"""Effect of the catalogue that is an amplifier's offset, a tilted guide, the zero of a force sensor."""
_LEAST_NOISE: Numerical[float] = 2e-4  # of a force: motion between samples is known no better
_ITERATIONS: Numerical[int] = 3


@dataclass(frozen=True, eq=False)
class Balances:
    """All balances of a campaign as rows: measured force = columns @ numbers + what is missing.

    Attributes
    ----------
    force : ndarray, shape (rows,)
        Measured forces less those of given masses [N].
    columns : ndarray, shape (rows, numbers)
        What the numbers named in `names` (paths of a model's parameters) multiply.
    noise : ndarray, shape (rows,)
        Standard deviation of what the sensors' white noise makes of a row [N].
    owner : ndarray of int, shape (rows,)
        Place in `records` of a row's record.
    """

    settings: CampaignSettings
    records: tuple[ForceRecord, ...]
    force: FloatArray
    columns: FloatArray
    names: tuple[str, ...]
    noise: FloatArray
    owner: npt.NDArray[np.int64]

    @cached_property
    def training(self) -> npt.NDArray[np.bool_]:
        """Rows of records that are not held out."""
        held = np.array([record.settings.hold_out for record in self.records], dtype=np.bool_)
        return np.asarray(~held[self.owner])

    def of(self, effect: Effect, stiffness: float, damping: float, *, training: bool = False) -> FloatArray:
        """Rows of an effect's force [N]; zero in held-out records where only training ones are asked for.

        Parameters
        ----------
        effect : Effect
            The effect.
        stiffness : float
            Stiffness of the link [N/m].
        damping : float
            Damping of the link [N s/m].
        training : bool
            Whether held-out records count as zero.

        Returns
        -------
        ndarray
            Shape (rows,) [N].
        """
        found = []
        for record in self.records:
            wanted = not (training and record.settings.hold_out)
            k = record.settings.given.get(f"{effect.enters}.stiffness.k", stiffness)
            rows = record.along(effect, k, damping) if wanted else None
            for balance in record.balances:
                sign = 1.0 if effect.enters == balance.place else balance.pulls.get(effect.enters, 0.0)
                still = np.zeros(len(balance.terms["force"]))
                found.append(still if rows is None or sign == 0.0 else sign * rows)
        return np.concatenate(found)

    def balanced(self, values: Mapping[str, float]) -> FloatArray:
        """Forces as a model of these numbers has them, those of given masses included [N], (rows,)."""
        given = [
            _given_force(balance, record.settings, self.settings)
            for record in self.records
            for balance in record.balances
        ]
        numbers = np.array([values[name] for name in self.names])
        return np.asarray(np.concatenate(given) + self.columns @ numbers)

    def by_channel(self, rows: FloatArray) -> Iterator[tuple[FloatArray, str, float]]:
        """Yield the rows of every balance, its force channel and the rate of its rows [Hz]."""
        first = 0
        for record in self.records:
            for balance in record.balances:
                count = len(balance.terms["force"])
                yield rows[first : first + count], balance.channel, record.smoothing.rate_hz(record.rate_hz)
                first += count

    def scaled(self, place: int, factor: float) -> Balances:
        """One record, by its place, as it would be with its motion multiplied; forces stay as measured."""
        rows, record = self.owner == place, self.records[place]
        along = np.array([factor, factor, 1.0])[:, None]
        moved = replace(record, motion={name: motion * along for name, motion in record.motion.items()})
        factors = [1.0 if name.endswith(f"{OFFSET}.F_0") else factor for name in self.names]
        return replace(
            self, records=(moved,), force=self.force[rows], columns=self.columns[rows] * factors,
            noise=self.noise[rows], owner=np.zeros(int(rows.sum()), dtype=np.int64),
        )  # fmt: skip

    def fitted(
        self, force: FloatArray, held: Mapping[str, float] = MappingProxyType({})
    ) -> tuple[FloatArray, FloatArray]:
        """Numbers that suit the training rows of a force best, and their standard errors.

        Masses, stiffnesses and dampings are not negative; the errors go with what is left over.

        Parameters
        ----------
        force : ndarray, shape (rows,)
            Force [N].
        held : mapping of str to float
            Numbers that are not fitted, by name; they have no error.

        Returns
        -------
        tuple of ndarray
            Numbers and errors, in the order of `names`.
        """
        numbers = np.array([held.get(name, 0.0) for name in self.names])
        errors, free = np.zeros(len(numbers)), np.array([name not in held for name in self.names])
        if not free.any():
            return numbers, errors
        rows = self.training
        matrix = self.columns[np.ix_(rows, free)] / self.noise[rows, None]
        target = (force - self.columns @ numbers)[rows] / self.noise[rows]
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        low = np.array([-np.inf if name.endswith(f"{OFFSET}.F_0") else 0.0 for name in self.names])
        triangle = np.asarray(np.linalg.qr(np.column_stack([matrix / size, target]), mode="r"))
        n = len(size)
        found = optimize.lsq_linear(triangle[:, :n], triangle[:, n], (low[free], np.inf), method="bvls").x
        spread = float(np.sum((target - (matrix / size) @ found) ** 2)) / max(len(target) - n, 1)
        covariance = np.linalg.pinv(triangle[:n, :n].T @ triangle[:n, :n], hermitian=True) * spread
        numbers[free] = found / size
        errors[free] = np.sqrt(np.maximum(np.diag(covariance), 0.0)) / size
        return numbers, errors

    def weighed(self, values: Mapping[str, float]) -> Balances:
        """The same with the noise that the sensors make through a model of these numbers."""
        noise, strongest = [], float(np.sqrt(np.mean(self.force**2)))
        for record in self.records:
            here = {**values, **_masses(record.settings, self.settings), **record.settings.given}
            for balance in record.balances:
                mass = here.get(f"body.{balance.place.removeprefix('body:')}.mass", 0.0)
                sums = [sum(here.get(f"{link}.{name}", 0.0) for link in balance.pulls)
                        for name in ("stiffness.k", "damping.c")]  # fmt: skip
                terms = (*sums, mass if balance.place.startswith("body:") else 0.0)
                level = np.hypot(
                    balance.motion_noise * record.smoothing.gain(terms, record.rate_hz),
                    balance.force_noise * record.smoothing.gain((1.0,), record.rate_hz),
                )
                least = _LEAST_NOISE * (float(np.sqrt(np.mean(balance.terms["force"] ** 2))) or strongest)
                noise.append(np.full(len(balance.terms["force"]), max(float(level), least, 1e-300)))
        return replace(self, noise=np.concatenate(noise))


def is_driven(campaign: Campaign) -> bool:
    """Whether bodies without a bolt train on driven or cycled records, with free ones beside at most."""
    tests = {record.test for record in campaign.select(hold_out=False)}
    bolted = any(link.law == "bolted" for link in campaign.settings.link)
    of_bodies = campaign.settings.modes is None and not bolted
    if not of_bodies or not tests & {"driven", "cycled"} or not tests <= set(TESTS):
        return False
    return all(_shows_displacement(campaign, record) for record in campaign.select(TESTS))


def _shows_displacement(campaign: Campaign, record: RecordSettings) -> bool:
    motions = measured_record(campaign, record).measurement.motion.values()
    return all(motion.kind == "displacement" for motion in motions)


def balances_of(campaign: Campaign) -> tuple[Balances, tuple[Doubt, ...]]:
    """Return the balances of a campaign's sound records, and the doubts about the others.

    Raises
    ------
    ValueError
        If no training record holds a force, or nothing can be told from it.
    """
    settings = campaign.settings
    chosen: list[Record] = []
    doubts: list[Doubt] = []
    for record in campaign.select(TESTS):
        found = measured_record(campaign, record)
        doubts += found.doubts
        chosen += [found.raw] if found.raw is not None and not found.doubts else []
    records = force_records(chosen, settings)
    trained = [b for r in records if not r.settings.hold_out for b in r.balances]
    if not any(np.any(balance.terms["force"]) for balance in trained):
        raise ValueError(f"{campaign.path}: found no training record with a force, expected one")
    pairs = [(record, balance) for record in records for balance in record.balances]
    tables = [_columns(balance, record.settings, settings) for record, balance in pairs]
    names = [name for name in dict.fromkeys(n for t in tables for n in t)
             if any(name in t and np.any(t[name]) for t, (r, _) in zip(tables, pairs, strict=True)
                    if not r.settings.hold_out)]  # fmt: skip
    force = [b.terms["force"] - _given_force(b, record.settings, settings) for record, b in pairs]
    columns = [
        np.stack([t.get(n, np.zeros(len(f))) for n in names], axis=1)
        for t, f in zip(tables, force, strict=True)
    ]
    places = {id(record): place for place, record in enumerate(records)}
    owner = np.concatenate([np.full(len(f), places[id(r)]) for (r, _), f in zip(pairs, force, strict=True)])
    rows = np.concatenate(force)
    balances = Balances(
        settings, records, rows, np.concatenate(columns), tuple(names), np.ones(len(rows)), owner
    )
    for _ in range(_ITERATIONS):
        values = balances.fitted(rows)[0].tolist()
        balances = balances.weighed(dict(zip(names, values, strict=True)))
    return balances, tuple(doubts)


def noise_share(balances: Balances) -> float:
    """Largest share of noise in the square of what a number multiplies on training records.

    By so much least squares makes that number too small (errors in variables).
    """
    derivatives = {".stiffness.k": 0, ".damping.c": 1, ".mass": 2}
    noise, whole = np.zeros(len(balances.names)), np.zeros(len(balances.names))
    for record in balances.records:
        if record.settings.hold_out:
            continue
        for balance in record.balances:
            found = _columns(balance, record.settings, balances.settings)
            for k, name in enumerate(balances.names):
                n = next((n for end, n in derivatives.items() if name.endswith(end)), None)
                if name in found and n is not None:
                    gain = record.smoothing.gain((0.0,) * n + (1.0,), record.rate_hz)
                    noise[k] += len(found[name]) * (balance.motion_noise * gain) ** 2
                    whole[k] += float(np.sum(found[name] ** 2))
    return float(np.max(noise / np.maximum(whole, 1e-300), initial=0.0))


def _masses(record: RecordSettings, settings: CampaignSettings) -> dict[str, float]:
    """Masses that are given, in the record or for the campaign [kg], by path."""
    masses = {f"body.{b.name}.mass": b.mass_kg for b in settings.body if b.mass_kg is not None}
    return masses | {path: value for path, value in record.given.items() if path.endswith(".mass")}


def _given_force(balance: Balance, record: RecordSettings, settings: CampaignSettings) -> FloatArray:
    """Force [N] of a balance's given mass, and of springs that its record gives, (rows,)."""
    mass = _masses(record, settings).get(f"body.{balance.place.removeprefix('body:')}.mass", 0.0)
    force = mass * balance.terms.get("acceleration", np.zeros(len(balance.terms["force"])))
    for link, sign in balance.pulls.items():
        k = record.given.get(f"{link}.stiffness.k")
        if k is not None:
            force = force + sign * k * balance.terms[f"{link}.x"]
    return force


def _columns(balance: Balance, record: RecordSettings, settings: CampaignSettings) -> dict[str, FloatArray]:
    """What each number multiplies in a balance, by the number's path."""
    kind, _, body = balance.place.partition(":")
    found = {}
    if kind == "body" and f"body.{body}.mass" not in _masses(record, settings):
        found[f"body.{body}.mass"] = balance.terms["acceleration"]
    for link in settings.link:
        sign = balance.pulls.get(link.name)
        if sign is not None:
            if link.law != "dashpot" and f"{link.name}.stiffness.k" not in record.given:
                found[f"{link.name}.stiffness.k"] = sign * balance.terms[f"{link.name}.x"]
            found[f"{link.name}.damping.c"] = sign * balance.terms[f"{link.name}.v"]
    return {**found, f"{balance.place}.{OFFSET}.F_0": -np.ones(len(balance.terms["force"]))}


def declared_model(balances: Balances) -> tuple[Model, tuple[str, ...]]:
    """Return the declared model that suits the training records best, and what to know of it."""
    values, errors = balances.fitted(balances.force)
    return model_of(balances, values, errors)


def model_of(
    balances: Balances, values: Sequence[float] | FloatArray, errors: Sequence[float] | FloatArray
) -> tuple[Model, tuple[str, ...]]:
    """Return the model with given numbers, ordered as ``balances.names``; offsets where they are told.

    Parameters
    ----------
    balances : Balances
        Balances of force of the campaign.
    values : sequence of float
        Values, ordered as ``balances.names``.
    errors : sequence of float
        Standard errors of the values.

    Returns
    -------
    tuple
        The model, and what to know of it.
    """
    settings, lines = balances.settings, []
    found = dict(zip(balances.names, zip(values, errors, strict=True), strict=True))
    bodies = []
    for body in settings.body:
        mass = body.mass_kg
        if mass is None:
            mass, error = found.get(f"body.{body.name}.mass", (0.0, 0.0))
            lines.append(_of_mass(body.name, mass, error))
        bodies.append(Body(body.name, float(mass) if mass and mass > 0 else 1.0))
    laws = {}
    for link in settings.link:
        if f"{link.name}.damping.c" not in found:
            lines.append(
                f"link {link.name}: no training record tells its stiffness or damping; zero stands in"
            )
        told = f"{link.name}.damping.c" in found  # without a stiffness: every record gives its own
        laws[link.name] = LinkLaws(
            _limited(
                constant_stiffness((link.stiffness_n_per_m or 0.0) if told else 0.0),
                found.get(f"{link.name}.stiffness.k"),
            ),
            _limited(constant_damping(0.0), found.get(f"{link.name}.damping.c")),
        )
    effects = []
    for name, (value, error) in found.items():
        place, _, _ = name.partition(f".{OFFSET}.")
        if place != name and abs(value) > RULES.beyond_chance * error:
            offset = Parameter(float(value), "N", *_limits(value, error), source="identified")
            effects.append(CATALOGUE[OFFSET].at(place, {"F_0": offset}))
    structure = Structure(tuple(bodies), tuple(Link(x.name, *x.between, x.law) for x in settings.link))
    model = Model(structure, laws, tuple(effects), windows=dict(settings.windows),
                  sampling=dict(settings.sampling))  # fmt: skip
    return model, tuple(lines)


def _of_mass(body: str, mass: float, error: float) -> str:
    if not mass > 0:
        return f"body {body}: no training record tells its mass; 1 kg stands in"
    return (
        f"body {body}: its mass {mass:.4g} +- {Z95 * error:.2g} kg is identified from the measured force; "
        "where forces or displacements are not in N and m, only the ratios of all numbers to the mass are "
        "identifiable"
    )


def _limited(law: Law, found: tuple[float, float] | None) -> Law:
    if found is None:
        return law
    (name, old), (value, error) = next(iter(law.parameters.items())), found
    low, high = _limits(value, error)
    number = replace(old, value=float(value), low=low, high=high, source="identified")
    return replace(law, parameters={name: number})


def _limits(value: float, error: float) -> tuple[float, float]:
    return float(value - Z95 * error), float(value + Z95 * error)


def standard_errors(balances: Balances, force: FloatArray, values: Sequence[float]) -> FloatArray:
    """Standard errors of the numbers of a model, (numbers,), from what it leaves over on training rows.

        sqrt(diag((C' C)^-1) s^2),   s^2 = mean((F - C theta)^2)

    Parameters
    ----------
    balances : Balances
        For the columns C, over the noise.
    force : ndarray, shape (rows,)
        Measured forces less those of effects, F [N].
    values : sequence of float
        The numbers theta [SI], ordered as ``balances.names``.
    """
    rows = balances.training
    noise = balances.noise[rows]
    remainder = (force[rows] - balances.columns[rows] @ list(values)) / noise
    scale = float(np.sqrt(np.mean(remainder**2)))
    matrix = balances.columns[rows] / noise[:, None]
    size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    gram = (matrix / size).T @ (matrix / size)
    return np.asarray(scale * np.sqrt(np.maximum(np.diag(np.linalg.pinv(gram, hermitian=True)), 0.0)) / size)
