"""The virtual rig against closed forms, the paper's numbers and itself."""

import json
from pathlib import Path

import numpy as np
import pytest

from experiments.rig import schedule, sensors
from experiments.rig.excitation import STEP_RATE_HZ
from experiments.studies import rig
from rom.campaign.campaign import read_campaign

# --- sensors ------------------------------------------------------------------------------------------------


def test_readings_have_the_stated_noise_and_steps() -> None:
    sensor = sensors.Instruments().strain
    reading = sensor.read(np.full(200_000, 0.7), np.random.default_rng(3))
    assert np.std(reading) == pytest.approx(3e-4, rel=0.01)
    counts = reading / (16.0 / 2**24)
    assert counts == pytest.approx(np.round(counts), abs=1e-6)
    assert np.ptp(np.round(counts)) > 1000  # the noise, not the step, limits
    quiet = sensor.scaled(0.0)
    assert np.all(quiet.read(np.full(10, 0.7), np.random.default_rng(3)) == 0.7)
    assert np.max(sensor.read(np.full(10, 9.0), np.random.default_rng(3))) == 8.0


def test_ac_coupling_has_its_corner_and_forgets_a_step() -> None:
    time = np.arange(round(20 * STEP_RATE_HZ)) / STEP_RATE_HZ
    corner = 1 / (2 * np.pi * 1.5)
    passed = sensors.couple(np.sin(2 * np.pi * corner * time), 1.5)
    whole = time > 20 - 1 / corner
    assert np.sqrt(2) * np.std(passed[whole]) == pytest.approx(np.sqrt(0.5), rel=1e-3)
    step = sensors.couple((time >= 1.0).astype(float), 1.5)
    assert step[np.searchsorted(time, 2.5)] == pytest.approx(np.exp(-1.0), rel=1e-4)
    assert sensors.couple(time, None) is time


@pytest.mark.parametrize("rate", [19_200.0, 4_800.0])
def test_anti_alias_passes_the_band_and_stops_what_would_fold(rate: float) -> None:
    lead = sensors.reach(rate) + 0.001
    start = -round(lead * STEP_RATE_HZ) / STEP_RATE_HZ
    analog = start + np.arange(round((0.5 - 2 * start) * STEP_RATE_HZ) + 1) / STEP_RATE_HZ
    time = np.arange(round(0.5 * rate)) / rate
    low = sensors.sample(np.sin(2 * np.pi * 0.3 * rate * analog), start, rate, 0.5)
    assert low == pytest.approx(np.sin(2 * np.pi * 0.3 * rate * time), abs=1e-3)  # no delay, no loss
    assert np.max(np.abs(sensors.sample(np.sin(2 * np.pi * 0.65 * rate * analog), start, rate, 0.5))) < 2e-4
    assert sensors.sample(np.ones_like(analog), start, rate, 0.5) == pytest.approx(1.0, abs=1e-12)


def test_strain_is_equation_1_backwards() -> None:
    tension = np.array([-1.0, 0.0, 5.8, 300.0, 3100.0])
    e = sensors.strain_of(tension)
    assert 2718.7 * e + 2363.7 * e**2 - 575.63 * e**3 == pytest.approx(tension, abs=1e-9)


def test_drift_leaves_a_loss_at_3000_newton_measurable() -> None:
    time = np.linspace(0.0, 8.5, 500)
    change = [
        np.diff(sensors.drift(sensors.Instruments(), time, np.random.default_rng(s))[[0, -1]])
        for s in range(50)
    ]
    assert 0.005 < np.std(change) < 0.06  # a tenth of the 0.59 N lost there


# --- schedule -----------------------------------------------------------------------------------------------


def planned(cases: int | None = None, **changes: object) -> tuple[schedule.Case, ...]:
    options = {
        "strengths": (1.0,),
        "scatter": 1.0,
        "tightening": cases is None,
        "hold_out_every": 5,
    } | changes
    return schedule.plan(cases, seed=np.random.SeedSequence(4), **options)  # type: ignore[arg-type]


def test_full_scale_is_the_papers() -> None:
    cases = planned()
    tests = [case.test for case in cases]
    assert [tests.count(test) for test in ("uncoupled", "coupled", "loosening")] == [2, 58, 84]
    tightened = [case for case in cases if case.gamma_factor < 0.0]
    assert len(tightened) == 26
    assert max(case.tension for case in tightened) < 1110.0
    preloads = np.array([case.preload for case in cases if case.test == "coupled"])
    assert (preloads[0], preloads[-1]) == (5.8, 3013.0)
    assert np.all(np.diff(preloads) > 0.0)
    high = np.array([case.hit.strength for case in cases if case.test == "loosening"])
    assert np.mean(high) == pytest.approx(1608.7, abs=4 * 81.65 / np.sqrt(84))
    assert np.std(high) == pytest.approx(81.65, rel=0.3)
    assert all(20.0 <= case.hit.strength <= 45.0 for case in cases if case.test != "loosening")
    assert len({case.file for case in cases}) == 144


def test_options_change_what_they_name_only() -> None:
    plain, calm = planned(20), planned(20, scatter=0.0)
    assert len(plain) == 42
    assert {case.gamma_factor for case in calm} == {1.0}
    assert [case.hit for case in plain] == [case.hit for case in calm]
    three = planned(5, strengths=(1.0, 0.8, 0.6))
    hits = [case.hit.strength for case in three if case.test == "loosening"]
    assert len(hits) == 15
    assert np.mean(hits[2::3]) == pytest.approx(0.6 * 1608.7, rel=0.1)


def test_hold_out_spares_the_extremes_and_keeps_a_preload_together() -> None:
    for count in (None, 20, 7):
        cases = [case for case in planned(count) if case.preload is not None]
        held = {case.preload for case in cases if case.hold_out}
        assert held
        assert not held & {cases[0].preload, cases[-1].preload}
        assert not held & {case.preload for case in cases if not case.hold_out}
    assert not any(case.hold_out for case in planned(20, hold_out_every=0))


def test_scatter_shrinks_with_preload() -> None:
    rng = np.random.default_rng(5)
    spread = [
        np.std(np.log10([schedule.gamma_factor(t, 1.0, rng) for _ in range(500)])) for t in (50, 800, 2000)
    ]
    assert spread[0] > 1.3 * spread[1] > 4 * spread[2] > 0.0


# --- campaigns ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rig.run(tmp_path_factory.mktemp("rig") / "small", cases=2, seed=7, jobs=2, duration_s=3.0)


def test_same_seed_same_bytes_for_any_jobs(small: Path, tmp_path: Path) -> None:
    other = rig.run(tmp_path / "small", cases=2, seed=7, jobs=1, duration_s=3.0)
    files = sorted(path.relative_to(small) for path in small.rglob("*") if path.is_file())
    assert len(files) == 7
    for file in files:
        assert (small / file).read_bytes() == (other / file).read_bytes(), file
    assert rig.truth_path(small).read_bytes() == rig.truth_path(other).read_bytes()
    third = rig.run(tmp_path / "third", cases=2, seed=8, duration_s=3.0)
    assert (third / files[1]).read_bytes() != (small / files[1]).read_bytes()


def test_the_campaign_reads_and_measures_what_happened(small: Path) -> None:
    campaign = read_campaign(small)
    truth = {record["file"]: record for record in json.loads(rig.truth_path(small).read_text())["records"]}
    assert set(truth) == {record.file for record in campaign.settings.record}
    for settings in campaign.select("loosening"):
        record = campaign.load(settings)
        assert record.channels["force_lo"].samples.max() == pytest.approx(
            truth[record.file]["hit"]["strength"], rel=0.01
        )
        e = record.channels["strain"].samples
        tension = 2718.7 * e + 2363.7 * e**2 - 575.63 * e**3
        assert np.mean(tension[:1920]) == pytest.approx(truth[record.file]["initial_tension_n"], abs=0.15)
        assert np.mean(tension[9600:]) == pytest.approx(truth[record.file]["final_tension_n"], abs=0.15)


def test_pre_trigger_shows_each_chains_noise(small: Path) -> None:
    campaign = read_campaign(small)
    for test, acceleration in (("coupled", 0.003), ("loosening", 0.05)):
        channels = campaign.load(campaign.select(test)[-1]).channels
        for name, expected in (("acceleration_lo", acceleration), ("force_lo", 0.05), ("strain", 3e-4)):
            steps = np.diff(
                channels[name].samples[: round(0.4 * channels[name].rate_hz)]
            )  # sheds slow motion
            assert np.std(steps) / np.sqrt(2) == pytest.approx(expected, rel=0.06), name


def test_the_truth_is_beside_the_folder_and_never_in_it(small: Path) -> None:
    assert rig.truth_path(small).parent == small.parent
    names = {path.name for path in small.rglob("*")}
    assert not any("truth" in name for name in names)
    declared = (small / "campaign.toml").read_text()
    assert "gamma" not in declared
    assert "9.763" not in declared
    truth = json.loads(rig.truth_path(small).read_text())
    assert truth["plant"]["damping_so"] == 2.696
    assert truth["plant"]["loosening"][0]["velocity_power"] == 4.0
    assert not list(small.parent.glob("*.tmp"))


def test_without_noise_only_the_instrument_remains(tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    folder = rig.run(
        tmp_path / "quiet",
        cases=2,
        noise=0.0,
        scatter=0.0,
        duration_s=2.5,
        progress=lambda done, total: steps.append((done, total)),
    )
    assert steps == [(done, 6) for done in range(7)]
    campaign = read_campaign(folder)
    channels = campaign.load(campaign.select("loosening")[0]).channels
    assert np.max(np.abs(channels["acceleration_lo"].samples[:9000])) < 1e-9
    assert np.ptp(channels["strain"].samples[:2000]) < 1e-12
    impulse = channels["force_lo"].samples.sum() / 19_200
    hit = json.loads(rig.truth_path(folder).read_text())["records"][3]["hit"]
    assert impulse == pytest.approx(2 / np.pi * hit["strength"] * hit["duration"], rel=1e-5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cases": 1}, "cases"),
        ({"noise": -1.0}, "noise"),
        ({"duration_s": 1.0}, "duration_s"),
        ({"jobs": 0}, "jobs"),
    ],
)
def test_refuses_what_cannot_be(tmp_path: Path, options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rig.run(tmp_path / "new", **options)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_refuses_an_existing_folder_before_computing(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()

    def called(done: int, total: int) -> None:
        raise AssertionError(f"computed {done} of {total}")

    with pytest.raises(ValueError, match="exists already"):
        rig.run(tmp_path / "there", cases=2, progress=called)
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
