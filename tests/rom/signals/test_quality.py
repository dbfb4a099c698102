from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt
import pytest
from scipy import signal

from rom.campaign.campaign import CampaignSettings, Record, RecordSettings
from rom.campaign.channels import FloatArray
from rom.campaign.record import Channel
from rom.signals.clipping import resolution
from rom.signals.quality import Doubt, assess
from tests.rom.sound_campaign import sound_settings

RATE_HZ, DURATION_S, IMPACT_S = 19200, 1.2, 0.5
TIME = np.arange(round(RATE_HZ * DURATION_S)) / RATE_HZ
SETTINGS = CampaignSettings.model_validate(sound_settings())
MASS = np.array([8.625, 0.9888])
JOINTS = {"loose": (5.4e5, 1000.0), "firm": (9.7e5, 1400.0), "tight": (9.8e5, 150.0)}  # N/m, N s/m


def pulse(start_s: float, peak: float, width_s: float = 1e-3) -> FloatArray:
    phase = (TIME - start_s) / width_s
    return np.where((phase > 0) & (phase < 1), peak * np.sin(np.pi * phase), 0.0)


def response(force: FloatArray, joint: str, struck: int, motion: str) -> FloatArray:
    """Motion (samples, bodies) of two masses on flexures, tied by a joint, one of them struck."""
    k, c = JOINTS[joint]
    coupling = np.array([[1.0, -1.0], [-1.0, 1.0]])
    stiffness = np.diag([8963.6, 91800.0]) + k * coupling
    damping = np.diag([8.2, 2.7]) + c * coupling
    inverse = np.diag(1 / MASS)
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    entry = np.zeros((4, 1))
    entry[2 + struck] = 1 / MASS[struck]
    rows = {"displacement": np.eye(4)[:2], "velocity": np.eye(4)[2:], "acceleration": state[2:]}[motion]
    through = entry[2:] if motion == "acceleration" else np.zeros((2, 1))
    return np.asarray(signal.lsim((state, entry, rows, through), force, TIME)[1])


@cache
def motions(joint: str, struck: int, motion: str, start_s: float, width_s: float) -> FloatArray:
    return response(pulse(start_s, 1.0, width_s), joint, struck, motion)


def record(
    test: str = "coupled",
    joint: str = "firm",
    peak: float = 30.0,
    noise: float = 1.0,
    struck: int = 0,
    motion: str = "acceleration",
    missed: tuple[float, float] | None = None,
    shown: tuple[float, float] | None = None,
    seed: int = 0,
) -> Record:
    """A record of one hit, of a second hit (delay [s], share) that the force misses, of one that it shows."""
    random = np.random.default_rng(seed)
    force = pulse(IMPACT_S, peak)
    moved = peak * motions(joint, struck, motion, IMPACT_S, 1e-3)
    for second in (missed, shown):
        if second is not None:
            delay, share = second
            moved = moved + share * peak * motions(joint, struck, motion, IMPACT_S + delay, 1.2e-3)
    if shown is not None:
        force = force + pulse(IMPACT_S + shown[0], shown[1] * peak, 1.2e-3)
    level = (
        noise
        * (0.003 if peak < 100 else 0.05)
        * {"acceleration": 1, "velocity": 1e-4, "displacement": 1e-7}[motion]
    )
    rows = {f"force_{('lo', 'so')[struck]}": force + 0.05 * noise * random.standard_normal(len(force))}
    for index, body in enumerate(("lo", "so")):
        rows[f"{motion}_{body}"] = moved[:, index] + level * random.standard_normal(len(force))
    return make(test, rows, ("lo", "so"))


def make(test: str, rows: dict[str, npt.NDArray[np.float64]], bodies: tuple[str, ...]) -> Record:
    settings = RecordSettings.model_validate({"file": "records/one.h5", "test": test})
    return Record(settings, {name: Channel(name, row, RATE_HZ) for name, row in rows.items()}, bodies)


def changed(record: Record, name: str, samples: FloatArray) -> Record:
    return Record(record.settings, {**record.channels, name: Channel(name, samples, RATE_HZ)}, record.bodies)


def found(record: Record) -> list[tuple[str, str]]:
    return [(doubt.kind, doubt.channel) for doubt in assess(record, SETTINGS)]


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize(("test", "peak"), [("coupled", 30.0), ("loosening", 1600.0)])
@pytest.mark.parametrize("noise", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("motion", ["acceleration", "velocity", "displacement"])
def test_good_records_raise_no_doubt(joint: str, test: str, peak: float, noise: float, motion: str) -> None:
    assert assess(record(test, joint, peak, noise, motion=motion), SETTINGS) == ()


@pytest.mark.slow
def test_false_alarms_are_rare_over_many_records() -> None:
    random = np.random.default_rng(3)
    alarms = 0
    for seed in range(200):
        joint = tuple(JOINTS)[seed % 3]
        peak = random.uniform(20, 45) if seed % 2 else random.uniform(500, 1700)
        test = "coupled" if peak < 100 else "loosening"
        noise = 10 ** random.uniform(-1, 1)
        alarms += bool(found(record(test, joint, peak, noise, struck=int(seed % 5 == 0), seed=seed)))
    assert alarms <= 1


class TestClipped:
    @pytest.mark.parametrize("name", ["force_lo", "acceleration_lo", "acceleration_so"])
    @pytest.mark.parametrize("share", [0.4, 0.9])
    @pytest.mark.parametrize("noise", [0.0, 1.0, 10.0])
    def test_a_channel_cut_at_a_level(self, name: str, share: float, noise: float) -> None:
        good = record("loosening", peak=1600.0, noise=noise)
        samples = good.channels[name].samples
        level = share * np.abs(samples).max()
        assert found(changed(good, name, np.clip(samples, -level, level))) == [("clipped", name)]

    def test_noise_after_the_cut_hides_it_not(self) -> None:
        good = record("loosening", peak=1600.0)
        samples = np.clip(good.channels["acceleration_lo"].samples, -60, 60)
        samples = samples + 0.05 * np.random.default_rng(1).standard_normal(len(samples))
        assert found(changed(good, "acceleration_lo", samples)) == [("clipped", "acceleration_lo")]

    def test_the_message_names_level_and_length(self) -> None:
        good = record("loosening", peak=1600.0, noise=0.0)
        samples = np.clip(good.channels["acceleration_lo"].samples, -60, 60)
        (doubt,) = assess(changed(good, "acceleration_lo", samples), SETTINGS)
        assert doubt == Doubt("records/one.h5", "acceleration_lo", "clipped", doubt.message)
        assert "acceleration_lo is clipped" in doubt.message
        assert doubt.message.endswith("60")

    @pytest.mark.parametrize(
        "samples",
        [
            np.zeros_like(TIME),
            np.full_like(TIME, 3.0),
            np.round(3 * np.sin(2 * np.pi * 15 * TIME)),  # quantised coarsely
            np.round(1000 * np.sin(2 * np.pi * 15 * TIME)) / 100,
            np.round(0.6 * np.random.default_rng(0).standard_normal(len(TIME))),  # noise of one step
            np.where(TIME < 0.5, 317.0, 316.0 + np.exp(-(TIME - 0.5))),  # a step down
            np.sin(2 * np.pi * 15 * TIME) * np.exp(-TIME),
            np.random.default_rng(0).standard_normal(len(TIME)).astype(np.float32).astype(np.float64),
            np.maximum(np.round(170 - 2 * (((np.arange(len(TIME)) - 1000) / 14) ** 2 - 1) ** 2), 0),
        ],
        ids=["zero", "constant", "coarse", "fine", "dithered", "step", "decay", "noise", "two modes"],
    )
    @pytest.mark.parametrize("name", ["displacement_lo", "tension"])
    def test_quiet_and_quantised_channels_are_not(self, samples: FloatArray, name: str) -> None:
        assert found(make("free", {name: samples}, ())) == []

    def test_an_empty_bolt_rests_at_zero(self) -> None:
        tension = np.maximum(20 - 30 * np.clip(TIME - 0.5, 0, 1) - 5 * (TIME > 1.0), 0) + 5 * (TIME > 1.1)
        assert found(make("loosening", {"tension": tension}, ())) == []

    @pytest.mark.parametrize(("test", "doubts"), [("cycled", 0), ("hold", 0), ("driven", 0), ("free", 1)])
    def test_commands_and_prescribed_motion_may_rest(self, test: str, doubts: int) -> None:
        square = np.clip(20 * np.sin(2 * np.pi * 5 * TIME), -1, 1)
        assert len(found(make(test, {"force_lo": square}, ()))) == doubts


class TestPolarity:
    @pytest.mark.parametrize("name", ["acceleration_lo", "acceleration_so", "force_lo"])
    @pytest.mark.parametrize("joint", JOINTS)
    @pytest.mark.parametrize(("peak", "noise"), [(30.0, 1.0), (30.0, 10.0), (1600.0, 10.0)])
    def test_one_flipped_channel_is_named(self, name: str, joint: str, peak: float, noise: float) -> None:
        good = record("coupled" if peak < 100 else "loosening", joint, peak, noise)
        assert found(changed(good, name, -good.channels[name].samples)) == [("polarity", name)]

    @pytest.mark.parametrize("motion", ["velocity", "displacement"])
    @pytest.mark.parametrize("body", ["lo", "so"])
    def test_of_velocity_and_displacement_too(self, motion: str, body: str) -> None:
        good = record(peak=1600.0, noise=0.1, motion=motion)
        name = f"{motion}_{body}"
        assert found(changed(good, name, -good.channels[name].samples)) == [("polarity", name)]

    def test_a_negative_force_is_no_flip(self) -> None:
        assert found(record(peak=-30.0)) == []

    def test_the_body_struck_may_be_either(self) -> None:
        good = record(struck=1)
        assert found(good) == []
        name = "acceleration_so"
        assert found(changed(good, name, -good.channels[name].samples)) == [("polarity", name)]

    def test_one_body_alone(self) -> None:
        good = record()
        rows = {name: good.channels[name].samples for name in ("force_lo", "acceleration_lo")}
        assert found(make("uncoupled", rows, ("lo",))) == []
        rows["acceleration_lo"] = -rows["acceleration_lo"]
        assert found(make("uncoupled", rows, ("lo",))) == [("polarity", "acceleration_lo")]


class TestSecondHit:
    @pytest.mark.parametrize("joint", JOINTS)
    @pytest.mark.parametrize(("peak", "noise"), [(30.0, 1.0), (1600.0, 1.0), (1600.0, 10.0)])
    @pytest.mark.parametrize("second", [(0.011, 0.3), (0.04, 0.05), (0.15, 0.1)])
    def test_one_that_the_force_misses(
        self, joint: str, peak: float, noise: float, second: tuple[float, float]
    ) -> None:
        bad = record("coupled" if peak < 100 else "loosening", joint, peak, noise, missed=second)
        (doubt,) = assess(bad, SETTINGS)
        assert (doubt.kind, doubt.channel) == ("second-hit", "force_lo")
        assert f"{IMPACT_S + second[0]:.3f}" in doubt.message

    def test_its_size_is_told(self) -> None:
        (doubt,) = assess(record(peak=1600.0, missed=(0.05, 0.2)), SETTINGS)
        share = float(doubt.message.split(" of ")[1].split(" %")[0])
        assert share == pytest.approx(20, abs=5)

    def test_one_that_the_force_shows_is_no_fault(self) -> None:
        assert found(record(peak=1600.0, shown=(0.04, 0.2))) == []

    def test_contacts_that_recur_are_the_structure_not_the_hammer(self) -> None:
        good = record(peak=1600.0)
        stop = sum(pulse(IMPACT_S + delay, 10.0) for delay in (0.02, 0.07, 0.13, 0.19))
        struck = good.channels["acceleration_lo"].samples + stop
        assert found(changed(good, "acceleration_lo", struck)) == []

    def test_on_one_body_alone(self) -> None:
        bad = record(peak=30.0, missed=(0.06, 0.2))
        rows = {name: bad.channels[name].samples for name in ("force_lo", "acceleration_lo")}
        assert found(make("uncoupled", rows, ("lo",))) == [("second-hit", "force_lo")]


def test_records_too_short_or_too_slow_for_a_verdict_raise_no_doubt() -> None:
    good = record()
    for samples, step in ((round(0.52 * RATE_HZ), 1), (len(TIME), 40)):
        rows = {name: channel.samples[:samples:step] for name, channel in good.channels.items()}
        channels = {name: Channel(name, row, RATE_HZ / step) for name, row in rows.items()}
        assert found(Record(good.settings, channels, good.bodies)) == []


def test_a_motion_of_another_rate_than_the_force_is_left_alone() -> None:
    good = record()
    slow = {name: Channel(name, channel.samples[::2], RATE_HZ / 2) for name, channel in good.channels.items()}
    mixed = {**good.channels, "acceleration_so": slow["acceleration_so"]}
    assert found(Record(good.settings, mixed, good.bodies)) == []


def test_a_step_below_the_rounding_of_a_channel_is_no_step() -> None:
    """Damaged bytes hold numbers so small that the others are no number of them: warnings are errors here."""
    rows = np.random.default_rng(1).integers(-9, 9, 500) * 1.0
    assert resolution(rows)[1] == 1.0
    rows[[3, 5]] = 0.0, 5e-324
    assert resolution(rows)[1] == 0.0
