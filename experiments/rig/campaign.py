"""Running the planned tests: records for the campaign folder, and the truth for beside it."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np
from joblib import Parallel, delayed

from experiments.rig.excitation import STEP_RATE_HZ, FloatArray
from experiments.rig.plant import Plant
from experiments.rig.readings import Seen
from experiments.rig.schedule import Case
from experiments.rig.sensors import CALIBRATION, Instruments, Transducer, couple, drift, sample, strain_of
from experiments.rig.simulation import Motion, run
from experiments.rig.undeclared import Undeclared
from rom.campaign.campaign import CampaignSettings
from rom.campaign.record import Channel

Truth = dict[str, object]


@dataclass(frozen=True)
class Laboratory:
    """The rig, what measures it, and for how long [s]."""

    plant: Plant
    instruments: Instruments
    duration: float

    def measure(self, case: Case, seed: np.random.SeedSequence) -> tuple[dict[str, Channel], Truth]:
        """Run one test; return its channels and what truly happened.

        Every disturbance draws from its own child of `seed`.
        """
        streams = [np.random.default_rng(child) for child in seed.spawn(7)]
        plant = self.plant if case.preload is not None else self.plant.without_bolt()
        plant = replace(plant, effects=tuple(effect.in_record(streams[6]) for effect in plant.effects))
        motion, channels = self.test(case, plant, streams[:6])
        return channels, truth_of(case, motion, plant)

    def test(
        self, case: Case, plant: Plant, streams: list[np.random.Generator]
    ) -> tuple[Motion, dict[str, Channel]]:
        """Run one test on the rig as it then stands; return its motion and its channels.

        Parameters
        ----------
        case : Case
            The test.
        plant : Plant
            The rig, its effects as they are in this record.
        streams : list of numpy.random.Generator
            Six: of the floor, three channels of motion and force, drift, and the gauge's noise.

        Returns
        -------
        motion : Motion
            What truly happened.
        channels : dict of str to Channel
            What was read.
        """
        start = -np.ceil(self.instruments.lead * STEP_RATE_HZ) / STEP_RATE_HZ
        motion = run(
            plant,
            case.hit,
            case.tension,
            self.duration - 2.0 * start,
            start=start,
            gamma_factor=case.gamma_factor,
            floor_rms=self.instruments.floor,
            rng=streams[0],
        )
        channels = self.motion_channels(case, motion, streams[1:4], plant.effects)
        if case.preload is not None:
            channels["strain"] = self.strain_channel(case, motion, streams[4:6], plant)
        return motion, channels

    def motion_channels(
        self,
        case: Case,
        motion: Motion,
        streams: list[np.random.Generator],
        effects: tuple[Undeclared, ...] = (),
    ) -> dict[str, Channel]:
        """Return force and accelerations as the data acquisition reads them, of the bodies that move.

        Parameters
        ----------
        case : Case
            The test; without a bolt only the body that is struck moves.
        motion : Motion
            What truly happened.
        streams : list of numpy.random.Generator
            Noise of the force and of the accelerations.
        effects : tuple of Undeclared
            Among them faults of these channels.

        Returns
        -------
        dict of str to Channel
            Force [N] and accelerations [m/s2].
        """
        kit, body = self.instruments, case.hit.body
        accelerometer = kit.sensitive if case.hit.strength < 100.0 else kit.robust

        def channel(
            name: str, analog: FloatArray, other: FloatArray, sensor: Transducer, rng: np.random.Generator
        ) -> Channel:
            seen = faulty(couple(analog, sensor.time_constant), f"sensor:{name}", motion.time, other, effects)
            sampled = sample(seen, float(motion.time[0]), kit.motion_rate_hz, self.duration)
            return Channel(name, sensor.read(sampled, rng), kit.motion_rate_hz)

        accelerations = {"lo": motion.acceleration_lo, "so": motion.acceleration_so}
        moving = tuple(accelerations) if case.preload is not None else (body,)
        force = case.hit.force(motion.time)
        named = [channel(f"force_{body}", force, force, kit.force, streams[0])]
        for name, rng in zip(moving, streams[1:], strict=False):
            other = accelerations["so" if name == "lo" else "lo"]
            named.append(channel(f"acceleration_{name}", accelerations[name], other, accelerometer, rng))
        return {channel.name: channel for channel in named}

    def strain_channel(
        self, case: Case, motion: Motion, streams: list[np.random.Generator], plant: Plant
    ) -> Channel:
        """Return the bolt's strain [mm/m]: Eq. 1 backwards from tension, its oscillating part and drift.

        Parameters
        ----------
        case : Case
            The test.
        motion : Motion
            What truly happened.
        streams : list of numpy.random.Generator
            Drift and noise.
        plant : Plant
            With effects on the reading and faults of the gauge.

        Returns
        -------
        Channel
            Strain [mm/m].
        """
        kit = self.instruments
        share = kit.oscillation * np.exp(-motion.tension / kit.oscillation_tension)
        apparent = motion.tension + share * (motion.displacement_lo - motion.displacement_so)
        apparent += drift(kit, motion.time, streams[0])
        for effect in plant.effects:
            if effect.kind.acts == "reading":
                apparent += effect.kind.function(seen_by_gauge(case, motion, plant), effect.values)
        apparent = faulty(apparent, "sensor:tension", motion.time, apparent, plant.effects)
        sampled = sample(strain_of(apparent), float(motion.time[0]), kit.tension_rate_hz, self.duration)
        return Channel("strain", kit.strain.read(sampled, streams[1]), kit.tension_rate_hz)

    def measure_all(
        self, cases: tuple[Case, ...], seeds: list[np.random.SeedSequence], jobs: int
    ) -> Iterator[tuple[Case, dict[str, Channel], Truth]]:
        """Run every test in order, `jobs` at a time, holding a few records only.

        Threads suffice: integrator and filters release the interpreter.

        Parameters
        ----------
        cases : tuple of Case
            The tests in order.
        seeds : list of numpy.random.SeedSequence
            One for each.
        jobs : int
            Threads.

        Yields
        ------
        case : Case
            The test.
        channels : dict of str to Channel
            What was read.
        truth : dict
            What no sensor tells.
        """
        pool = Parallel(n_jobs=jobs, prefer="threads")
        for first in range(0, len(cases), 2 * jobs):
            batch = slice(first, first + 2 * jobs)
            results = pool(
                delayed(self.measure)(*pair) for pair in zip(cases[batch], seeds[batch], strict=True)
            )
            for case, (channels, truth) in zip(cases[batch], results, strict=True):
                yield case, channels, truth


def faulty(
    analog: FloatArray, channel: str, time: FloatArray, other: FloatArray, effects: tuple[Undeclared, ...]
) -> FloatArray:
    """Return what a channel with undeclared faults makes of a signal, in the order of the faults.

    Parameters
    ----------
    analog : ndarray, shape (steps,)
        The signal before it is sampled.
    channel : str
        Such as ``"sensor:force_lo"``.
    time : ndarray, shape (steps,)
        Times [s].
    other : ndarray, shape (steps,)
        The signal that a fault may mix in.
    effects : tuple of Undeclared
        All of the rig; those of other places are left out.

    Returns
    -------
    ndarray, shape (steps,)
        The signal with its faults.
    """
    for effect in effects:
        if effect.enters == channel:
            analog = effect.kind.function(analog, time, effect.values, other)
    return analog


def seen_by_gauge(case: Case, motion: Motion, plant: Plant) -> Seen:
    """Collect what the gauge of the bolt might show besides its tension.

    Parameters
    ----------
    case : Case
        The test, with the instant of its hit.
    motion : Motion
        What truly happened.
    plant : Plant
        Stiffness and damping of the joint.

    Returns
    -------
    Seen
        Time, time since the hit, relative motion, force in the joint, and displacement of LO.
    """
    c = plant.constants()
    x, v = motion.displacement_lo - motion.displacement_so, motion.velocity_lo - motion.velocity_so
    stiffness = c.k_i / (1.0 + np.exp(c.alpha * (motion.tension - c.beta)))
    damping = c.c_d - c.c_i / (1.0 + np.exp(c.eta * motion.tension))
    since = np.maximum(motion.time - case.hit.start, 0.0)
    return Seen(motion.time, since, x, v, stiffness * x + damping * v, motion.displacement_lo)


def truth_of(case: Case, motion: Motion, plant: Plant) -> Truth:
    """Return what no sensor tells about one test.

    Parameters
    ----------
    case : Case
        The test.
    motion : Motion
        What truly happened.
    plant : Plant
        With effects as they were in this record.

    Returns
    -------
    dict
        The case, first and last tension [N], and numbers of each record's own.
    """
    bolted = case.preload is not None
    own = {
        f"{effect.name}@{effect.enters}": dict(effect.parameters)
        for effect in plant.effects
        if effect.kind.by_record
    }
    return asdict(case) | {
        "initial_tension_n": float(motion.tension[0]) if bolted else None,
        "final_tension_n": float(motion.tension[-1]) if bolted else None,
        **({"undeclared": own} if own else {}),
    }


def settings(name: str, cases: tuple[Case, ...], plant: Plant, instruments: Instruments) -> CampaignSettings:
    """Return campaign.toml: what the operator knows, and nothing of the truth.

    Parameters
    ----------
    name : str
        Of the campaign.
    cases : tuple of Case
        The tests.
    plant : Plant
        Of which only the masses are told.
    instruments : Instruments
        Of which only the sampling rates are told.

    Returns
    -------
    CampaignSettings
        Checked.
    """
    return CampaignSettings.model_validate(
        {
            "format": "boltlaw-campaign/1",
            "name": name,
            "body": [{"name": "lo", "mass_kg": plant.mass_lo}, {"name": "so", "mass_kg": plant.mass_so}],
            "link": [
                {"name": "flexure_lo", "between": ["lo", "ground"], "law": "linear"},
                {"name": "flexure_so", "between": ["so", "ground"], "law": "linear"},
                {"name": "joint", "between": ["lo", "so"], "law": "bolted"},
            ],
            "bolt": {"link": "joint", "calibration": list(CALIBRATION)},
            "sampling": {
                "motion_rate_hz": instruments.motion_rate_hz,
                "tension_rate_hz": instruments.tension_rate_hz,
                "pretrigger_s": 0.5,
            },
            "windows": {"initial_s": [0.0, 0.4], "final_s": [2.0, 8.0]},
            "record": [record(case) for case in cases],
        }
    )


def record(case: Case) -> dict[str, object]:
    """Return a record's entry in campaign.toml."""
    entry: dict[str, object] = {"file": case.file, "test": case.test, "hold_out": case.hold_out}
    if case.preload is None:
        return entry | {"bodies": [case.hit.body]}
    return entry | {"preload_n": case.preload}
