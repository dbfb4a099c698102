"""A record as a model would have it measured: simulated from the measured hit, with noise drawn anew.

The hit and the initial tension are those of the record. Noise is drawn in the raw channels, the force's too,
so that it passes through all processing: white noise e_j convolved with what channels showed before the hits
of K tests of the kind, q_j,

    n(t) = K^(-1/2) sum_j sum_s w(s) q_j(s) e_j(t - s) / (sum_s w(s)^2)^(1/2),

is a stationary Gaussian course with their mean spectra, those between channels included: these share e_j.
(Lines of one record's spectrum scatter as noise does, and drawn with them it would have heavy tails, which
floors by medians underrate.) The rate of loosening differs by a factor of its own,
drawn with the model's between-test variability.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import signal

from rom.campaign.campaign import CampaignSettings, Record
from rom.campaign.channels import BOLT_CHANNELS, GROUND_CHANNELS, Channel, FloatArray
from rom.criteria.number import Numerical
from rom.evaluation.replay import Replay, replay, shown_tension
from rom.identification.gamma_per_case import own_rate
from rom.identification.modal_sensors import as_sensors_show, by_measured_force
from rom.identification.noise_spectrum import before_margin
from rom.model.effect import SensorFault
from rom.model.model import Model
from rom.signals.calibration import Calibration
from rom.signals.processing import IMPACT_TESTS, Measurement
from rom.signals.sensor_correction import faults_of

_STEPS: Numerical[int] = 20
_TOLERANCE: Numerical[float] = 1e-8  # as the last fit of a closure: what 1.5e-6 leaves out shows


def cannot_be_simulated(record: Record) -> str:
    """Return why a record cannot be replaced by a simulated one; empty where it can."""
    if record.test not in IMPACT_TESTS:
        return f'{record.file}: found a "{record.test}" record, expected impact tests alone'
    if set(GROUND_CHANNELS) & set(record.channels):
        return f"{record.file}: found a ground that moves, expected one at rest"
    return ""


def quiet_part(record: Record, measurement: Measurement) -> Record:
    """Return what a record shows before its hit."""
    seconds = before_margin(measurement.impact_s or 0.0)
    channels = {
        name: replace(channel, samples=channel.samples[: int(seconds * channel.rate_hz)])
        for name, channel in record.channels.items()
    }
    return replace(record, channels=channels)


def simulated_record(
    model: Model,
    record: Record,
    measurement: Measurement,
    settings: CampaignSettings,
    quiet: Sequence[Record],
    generator: np.random.Generator,
) -> dict[str, Channel]:
    """Return the channels of an impact test as a model would have shown them, noise included.

    Parameters
    ----------
    model : Model
        Whose motion and tension are shown.
    record : Record
        The measured record: its hit, its rates.
    measurement : Measurement
        The same, processed.
    settings : CampaignSettings
        For the calibration of the strain.
    quiet : sequence of Record
        What tests of the kind show before their hits, this one among them.
    generator : numpy.random.Generator
        Draws the noise and the test's own rate of loosening.

    Returns
    -------
    dict of str to Channel
        As many as the record has, over what all of them cover.

    Raises
    ------
    ValueError
        If the simulation does not finish.
    """
    run = replay(_of_a_test(model, measurement, generator), measurement, _TOLERANCE)
    if run.response.status != "ok":
        raise ValueError(f"{record.file}: found a simulation that does not finish, expected one that does")
    clean = {**_hits(record, measurement), **_shown(run, record, settings)}
    alike = [q for q in quiet if q.test == record.test and q.bodies == record.bodies]
    shown = dict(record.channels)
    for rate_hz in dict.fromkeys(record.channels[name].rate_hz for name in clean):
        names = [name for name in clean if record.channels[name].rate_hz == rate_hz]
        noise = _noise(names, max(len(clean[name]) for name in names), alike, generator)
        for name in names:
            samples = clean[name] + noise[name][: len(clean[name])]
            shown[name] = Channel(name, samples, rate_hz)
    return shown


def _hits(record: Record, measurement: Measurement) -> dict[str, FloatArray]:
    """The forces that the model takes, by channel: of those measured the contacts alone, without noise."""
    return {
        f"force_{body}": np.interp(
            record.channels[f"force_{body}"].time, np.arange(len(force)) / measurement.rate_hz, force
        )
        for body, force in measurement.force.items()
    }


def _of_a_test(model: Model, measurement: Measurement, generator: np.random.Generator) -> Model:
    """The model with a rate of loosening of this test's own."""
    known, tension = model.rate_uncertainty, measurement.tension
    if known is None or tension is None or measurement.test != "loosening":
        return model
    deviation = known.of_a_test(tension.initial) * generator.standard_normal()
    return model.with_effect(own_rate(float(np.exp(deviation))))


def _shown(run: Replay, record: Record, settings: CampaignSettings) -> dict[str, FloatArray]:
    """What the sensors show of a response, by channel, without noise."""
    faults, found = faults_of(run.model), dict[str, FloatArray]()
    motion = as_sensors_show(run.model, run.response, run.measurement)
    sampled = by_measured_force(run.model, run.response, run.measurement)
    for body, of_body in run.measurement.motion.items():
        name, channel = f"{of_body.kind}_{body}", record.motion(body)[1]
        of_kind = {**motion[of_body.kind], **(sampled if of_body.kind == "acceleration" else {})}
        found[name] = np.interp(channel.time, run.response.time, of_kind[body])
    for name in found:
        found[name] = _with_faults(found, name, record.channels[name].rate_hz, faults)
    tension = run.measurement.tension
    if tension is not None and isinstance(run.response.tension, np.ndarray):
        channel = record.tension_channel()
        held = shown_tension(run, tension)[0]
        for fault in faults:
            held = fault.apply(held, tension.rate_hz) if fault.channel == "tension" else held
        found[channel.name] = _strain(held, channel, settings) if channel.name == "strain" else held
    return found


def _with_faults(
    true: Mapping[str, FloatArray], name: str, rate_hz: float, faults: Sequence[SensorFault]
) -> FloatArray:
    shown = true[name]
    for fault in faults:
        if fault.channel == name:
            others = [s for other, s in true.items() if other != name and other.startswith(f"{fault.other}_")]
            if not fault.other or others:
                shown = fault.apply(shown, rate_hz, others[0] if fault.other else None)
    return shown


def _strain(tension: FloatArray, channel: Channel, settings: CampaignSettings) -> FloatArray:
    """The gauge's reading at a tension: Newton's steps from the measured reading."""
    assert settings.bolt is not None
    assert settings.bolt.calibration is not None
    calibration = Calibration(tuple(settings.bolt.calibration))
    strain = np.full(len(tension), float(np.median(channel.samples)))
    for _ in range(_STEPS):
        strain = strain - (calibration.tension(strain) - tension) / calibration.sensitivity(strain)
    return strain


def _noise(
    names: Sequence[str], length: int, quiet: Sequence[Record], generator: np.random.Generator
) -> dict[str, FloatArray]:
    """Noise of channels of one rate, drawn together; of motion with the mean that it has before the hits."""
    able = [one.channels for one in quiet if set(names) <= set(one.channels)]
    found = {name: np.zeros(length) for name in names}
    for channels in able:
        count = min(len(channels[name].samples) for name in names)
        window = signal.windows.hann(count, sym=False)
        white = generator.standard_normal(length + count - 1) / np.sqrt(len(able) * np.sum(window**2))
        for name in names:
            part = channels[name].samples[:count]
            found[name] += signal.fftconvolve(white, window * (part - part.mean()), mode="valid")
            found[name] += 0.0 if name in BOLT_CHANNELS else part.mean() / len(able)
    return found
