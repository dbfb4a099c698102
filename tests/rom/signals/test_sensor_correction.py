"""Faults of sensors are taken out of a record before anything is compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rom.effects import CATALOGUE, SensorFault, candidates
from rom.evaluation.error_measures import Comparison, compare, compare_all
from rom.identification.curve_fits import gamma_curve
from rom.identification.identify import Identification
from rom.model.model import Model
from rom.parameters.he_2025 import paper_model
from rom.signals.processing import Measurement
from rom.signals.sensor_correction import corrected
from tests.rom.shown_records import IMPACT_S, RATE_HZ, SETTINGS, record

MODEL = paper_model()
CHANNELS = ("force_lo", "acceleration_lo", "acceleration_so", "tension")
FAULTS = [e for _, e in candidates(MODEL, CHANNELS, core=False) if e.kind == "sensor fault"]
WINDOWS = SETTINGS.windows
# what the filters hide, or the means of the tension
HIDDEN = (
    "acceleration-bias",
    "ac-coupling",
    "tension-skew",
    "sensor:force_lo.hum",
    "sensor:tension.hum",
)


def fault(name: str, channel: str, **values: float) -> SensorFault:
    found = CATALOGUE[name].at(f"sensor:{channel}").with_values(**values)
    assert isinstance(found, SensorFault)
    return found


def worst(found: Comparison) -> float:
    return max(*found.motion_nrmse.values(), found.relative_motion_nrmse, found.tension_rmse / 10)


@pytest.fixture(scope="module")
def clean() -> float:
    return worst(compare(MODEL, record(MODEL), WINDOWS))


@pytest.mark.parametrize("effect", FAULTS, ids=lambda effect: f"{effect.name} of {effect.channel}")
def test_a_model_that_knows_a_fault_is_as_right_as_without_one(effect: SensorFault, clean: float) -> None:
    shown = record(MODEL, [effect])
    assert worst(compare(effect.added_to(MODEL), shown, WINDOWS)) < clean + 0.01
    if effect.name not in HIDDEN and effect.path not in HIDDEN:
        assert worst(compare(MODEL, shown, WINDOWS)) > clean + 0.01


@pytest.mark.parametrize("effect", FAULTS, ids=lambda effect: f"{effect.name} of {effect.channel}")
def test_samples_are_those_that_a_sound_sensor_shows(effect: SensorFault) -> None:
    def samples(of: Measurement) -> np.ndarray:
        if effect.channel == "tension":
            assert of.tension is not None
            return of.tension.samples
        quantity, _, body = effect.channel.partition("_")
        return of.force[body] if quantity == "force" else of.motion[body].samples

    shown, true = record(MODEL, [effect]), samples(record(MODEL))
    error = np.std(samples(corrected(shown, effect.added_to(MODEL))) - true)
    assert error < 0.1 * np.sqrt(np.mean((samples(shown) - true) ** 2))


def test_a_force_is_right_before_it_drives() -> None:
    shown = record(MODEL, [fault("force-gain", "force_lo", g=0.1)])
    seen = corrected(shown, fault("force-gain", "force_lo", g=0.1).added_to(MODEL))
    assert seen.applied_force["lo"].max() == pytest.approx(shown.applied_force["lo"].max() / 1.1)
    assert seen.displacement("lo") is not shown.displacement("so")


def test_a_force_stays_zero_outside_its_contacts() -> None:
    hum = fault("hum", "force_lo", A=2.0, B=1.0)
    shown = record(MODEL)
    seen = corrected(shown, hum.added_to(MODEL))
    contact = shown.force["lo"] != 0.0
    assert not seen.force["lo"][~contact].any()
    phase = 2 * np.pi * 50.0 * np.arange(len(contact)) / RATE_HZ
    line = 2.0 * np.cos(phase) + np.sin(phase)
    assert (shown.force["lo"] - seen.force["lo"])[contact] == pytest.approx(line[contact])


def test_tensions_are_means_of_the_corrected_tension() -> None:
    shown = record(MODEL).tension
    assert shown is not None
    effect = fault("calibration-error", "tension", T_0=5.0, c_1=0.2)
    found = compare(effect.added_to(MODEL), record(MODEL, [effect]), WINDOWS)
    assert (found.initial_tension, found.measured_final) == pytest.approx((shown.initial, shown.final))


def test_faults_of_one_channel_are_taken_out_from_the_last_to_the_first() -> None:
    faults = [
        fault("acceleration-gain", "acceleration_so", g=0.2),
        fault("acceleration-bias", "acceleration_so"),
    ]
    model = faults[1].added_to(faults[0].added_to(MODEL))
    seen = corrected(record(MODEL, faults), model)
    assert seen.motion["so"].samples == pytest.approx(record(MODEL).motion["so"].samples, abs=1e-9)


def test_models_with_different_faults_stand_side_by_side() -> None:
    effect = fault("acceleration-gain", "acceleration_so", g=0.2)
    shown = record(MODEL, [effect])
    before, after = compare_all([MODEL, effect.added_to(MODEL)], shown, WINDOWS)
    assert before.motion_nrmse["so"] > 0.1
    assert after.motion_nrmse["so"] < 0.005
    assert before.motion_nrmse["lo"] == pytest.approx(after.motion_nrmse["lo"])


def test_what_a_record_does_not_show_is_left_alone() -> None:
    shown = record(MODEL)
    model = fault("acceleration-gain", "velocity_so").added_to(MODEL)
    assert corrected(shown, model) is shown
    assert shown.impact_s == pytest.approx(IMPACT_S, abs=1e-3)


def test_gamma_is_learned_again_on_hits_without_the_fault_of_their_hammer(
    rig_identified: Identification,
) -> None:
    found = rig_identified
    shown = replace(found, courses=tuple(replace(c, force=1.1 * c.force) for c in found.courses))

    def gamma(of: Identification, model: Model) -> float:
        law = of.with_model(model).model.link_laws["joint"].tension_rate
        assert law is not None
        return float(gamma_curve(law, np.array([100.0]))[0])

    right, gain = gamma(found, found.model), fault("force-gain", "force_lo", g=0.1)
    assert gamma(shown, gain.added_to(found.model)) == pytest.approx(right, rel=1e-3)
    assert gamma(shown, found.model) == pytest.approx(right / 1.1**4, rel=0.05)
