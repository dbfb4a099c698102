"""Running the planned tests: records for the campaign folder, and the truth for beside it."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np
from joblib import Parallel, delayed

from experiments.rig.plant import Plant
from experiments.rig.schedule import Case
from experiments.rig.sensors import CALIBRATION, Instruments, Transducer, couple, drift, sample, strain_of
from experiments.rig.simulation import STEP_RATE_HZ, Motion, run
from rom.campaign import CampaignSettings
from rom.records import Channel

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
        streams = [np.random.default_rng(child) for child in seed.spawn(6)]
        start = -np.ceil(self.instruments.lead * STEP_RATE_HZ) / STEP_RATE_HZ
        motion = run(
            self.plant if case.preload is not None else self.plant.without_bolt(),
            case.hit,
            case.tension,
            self.duration - 2.0 * start,
            start=start,
            gamma_factor=case.gamma_factor,
            floor_rms=self.instruments.floor,
            rng=streams[0],
        )
        channels = self.motion_channels(case, motion, streams[1:4])
        if case.preload is not None:
            channels["strain"] = self.strain_channel(motion, streams[4:])
        return channels, truth_of(case, motion)

    def motion_channels(
        self, case: Case, motion: Motion, streams: list[np.random.Generator]
    ) -> dict[str, Channel]:
        """Return force and accelerations as the data acquisition reads them, of the bodies that move."""
        kit, body = self.instruments, case.hit.body
        accelerometer = kit.sensitive if case.hit.strength < 100.0 else kit.robust

        def channel(name: str, analog: np.ndarray, sensor: Transducer, rng: np.random.Generator) -> Channel:
            coupled = couple(analog, sensor.time_constant)
            sampled = sample(coupled, float(motion.time[0]), kit.motion_rate_hz, self.duration)
            return Channel(name, sensor.read(sampled, rng), kit.motion_rate_hz)

        accelerations = {"lo": motion.acceleration_lo, "so": motion.acceleration_so}
        moving = accelerations if case.preload is not None else {body: accelerations[body]}
        named = [channel(f"force_{body}", case.hit.force(motion.time), kit.force, streams[0])]
        for (name, analog), rng in zip(moving.items(), streams[1:], strict=False):
            named.append(channel(f"acceleration_{name}", analog, accelerometer, rng))
        return {channel.name: channel for channel in named}

    def strain_channel(self, motion: Motion, streams: list[np.random.Generator]) -> Channel:
        """Return the bolt's strain [mm/m]: Eq. 1 backwards from tension, its oscillating part and drift."""
        kit = self.instruments
        share = kit.oscillation * np.exp(-motion.tension / kit.oscillation_tension)
        apparent = motion.tension + share * (motion.displacement_lo - motion.displacement_so)
        apparent += drift(kit, motion.time, streams[0])
        sampled = sample(strain_of(apparent), float(motion.time[0]), kit.tension_rate_hz, self.duration)
        return Channel("strain", kit.strain.read(sampled, streams[1]), kit.tension_rate_hz)

    def measure_all(
        self, cases: tuple[Case, ...], seeds: list[np.random.SeedSequence], jobs: int
    ) -> Iterator[tuple[Case, dict[str, Channel], Truth]]:
        """Run every test in order, `jobs` at a time, holding a few records only.

        Threads suffice: integrator and filters release the interpreter.
        """
        pool = Parallel(n_jobs=jobs, prefer="threads")
        for first in range(0, len(cases), 2 * jobs):
            batch = slice(first, first + 2 * jobs)
            results = pool(
                delayed(self.measure)(*pair) for pair in zip(cases[batch], seeds[batch], strict=True)
            )
            for case, (channels, truth) in zip(cases[batch], results, strict=True):
                yield case, channels, truth


def truth_of(case: Case, motion: Motion) -> Truth:
    """Return what no sensor tells about one test."""
    bolted = case.preload is not None
    return asdict(case) | {
        "initial_tension_n": float(motion.tension[0]) if bolted else None,
        "final_tension_n": float(motion.tension[-1]) if bolted else None,
    }


def settings(name: str, cases: tuple[Case, ...], plant: Plant, instruments: Instruments) -> CampaignSettings:
    """Return campaign.toml: what the operator knows, and nothing of the truth."""
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
