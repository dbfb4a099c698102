"""What an added effect does along measured motions: its force, its reading, or the rate that it changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rom.campaign.campaign import Campaign, RecordSettings
from rom.campaign.channels import FloatArray
from rom.effects import LawChange, ModelCorrection, Reading
from rom.effects.observation import motion_of
from rom.evaluation.replay import Replay, replay
from rom.model.link_force import force_of_effects
from rom.model.model import Model
from rom.signals.measured_records import measured_record

_TESTS = ("loosening", "driven", "coupled", "free")  # the hardest motion first
_SHOWN_S = 0.2  # after the impact
_POINTS = 1200  # of a curve
_AMPLITUDES = 60
_CYCLE = 256
_RECORDS = 3


def effect_curves(
    model: Model, effects: Sequence[ModelCorrection], campaign: Campaign
) -> list[dict[str, Any] | None]:
    """Return for each effect what there is to draw; None for effects on bodies and faults of sensors.

    Forces and readings run along the motion that the refined model has in up to three training records, from
    low to high preload. Rates are means over a cycle of harmonic motion, at the tension and the frequency of
    these.

    Parameters
    ----------
    model : Model
        The refined model.
    effects : sequence of ModelCorrection
        Those that were added.
    campaign : Campaign
        Whose training records give motions.

    Returns
    -------
    list of dict or None
        Kind and records of each effect's curve.
    """
    one_bolt = len(model.structure.bolted_links) == 1
    drawn = [
        e.enters in model.link_laws if e.kind == "force" else one_bolt and e.kind in ("law change", "reading")
        for e in effects
    ]
    if not any(drawn):
        return [None] * len(effects)
    runs = list(_runs(model, campaign))
    return [_curve(effect, runs) if there else None for effect, there in zip(effects, drawn, strict=True)]


def _runs(model: Model, campaign: Campaign) -> Iterator[tuple[RecordSettings, Replay]]:
    """Yield training records of different preload, run again."""
    for test in _TESTS:
        chosen = [record for record in campaign.select(test) if not record.hold_out]
        if not chosen:
            continue
        chosen.sort(key=lambda record: record.preload_n or 0.0)
        places = np.linspace(0, len(chosen) - 1, min(_RECORDS, len(chosen))).round().astype(int)
        for place in dict.fromkeys(places.tolist()):
            found = measured_record(campaign, chosen[place])
            if found.doubts:
                continue
            run = replay(model, found.measurement.with_cutoff(model.filter_cutoff_hz))
            if run.response.status == "ok":
                yield chosen[place], run
        return


def _curve(effect: ModelCorrection, runs: Sequence[tuple[RecordSettings, Replay]]) -> dict[str, Any] | None:
    match effect:
        case LawChange():
            kind, curves = "tension rate", [_head(record, run) | _rate(effect, run) for record, run in runs]
        case Reading():
            kind, curves = "reading", [_head(record, run) | _reading(effect, run) for record, run in runs]
        case _:
            kind, there = "force", [(r, run) for r, run in runs if effect.enters in run.model.link_laws]
            curves = [_head(record, run) | _force(effect, run) for record, run in there]
    return {"kind": kind, "records": curves} if curves else None


def _head(record: RecordSettings, run: Replay) -> dict[str, Any]:
    bolted = run.model.structure.bolted_links
    tension = float(np.asarray(run.response.tension)[0]) if len(bolted) == 1 else None
    return {"file": record.file, "preload_n": record.preload_n, "initial_tension_n": tension}


def _force(effect: ModelCorrection, run: Replay) -> dict[str, Any]:
    """Force of an effect alone along the motion of its link, from shortly before an impact on."""
    x, v, tension = _motion(run, effect.enters)
    laws, time = run.model.link_laws[effect.enters], run.response.time
    impact = run.measurement.impact_s
    end = len(time) if impact is None else int(np.searchsorted(time, impact + _SHOWN_S))
    along = np.stack([x, v, tension, laws.stiffness(tension), laws.damping(tension)])[:, :end]
    alone = replace(run.model, effects=(effect,)).assembly
    force = force_of_effects(alone, effect.enters, along, float(time[1] - time[0]))
    start = int(np.searchsorted(time, (impact or 0.0) - 0.005))
    shown = slice(start, end, max((end - start) // _POINTS, 1))
    return {"displacement_m": x[shown], "velocity_m_per_s": v[shown], "force_n": force[shown]}


def _reading(effect: Reading, run: Replay) -> dict[str, Any]:
    """What a gauge shows of an effect, over the whole record."""
    impact = run.measurement.impact_s or 0.0
    motion = motion_of(run.model, run.response, impact)
    shown = slice(None, None, max(len(motion.time) // _POINTS, 1))
    return {
        "displacement_m": motion.displacement[shown],
        "time_s": motion.time[shown] - impact,
        "reading_n": effect.added(motion)[shown],
    }


def _rate(effect: LawChange, run: Replay) -> dict[str, Any]:
    """Mean rate over a cycle of harmonic motion, with and without an effect, over the peak velocity."""
    (link,) = run.model.structure.bolted_links
    x, v, tension = _motion(run, link)
    speed = np.geomspace(0.02, 1.0, _AMPLITUDES) * max(float(np.abs(v).max()), 1e-9)
    frequency = float(v.std() / x.std()) if x.std() > 0 else 100.0  # [rad/s], of most of the motion
    phase = 2 * np.pi * np.arange(_CYCLE) / _CYCLE
    without = replace(run.model, effects=tuple(e for e in run.model.effects if e.path != effect.path))
    rates = [
        _cycle_mean(model, link, speed[:, None] * np.sin(phase) / frequency, speed[:, None] * np.cos(phase),
                    max(float(tension[0]), 0.0))
        for model in (without, run.model)
    ]  # fmt: skip
    return {"peak_velocity_m_per_s": speed, "rate_without_n_per_s": rates[0], "rate_n_per_s": rates[1]}


def _cycle_mean(model: Model, link: str, x: FloatArray, v: FloatArray, tension: float) -> FloatArray:
    laws = model.acting_laws[link]
    assert laws.tension_rate is not None
    damping_force = float(laws.damping(tension)) * v
    force = float(laws.stiffness(tension)) * x + damping_force
    return np.asarray(laws.tension_rate.rate(tension, x, v, force, damping_force).mean(axis=1))


def _motion(run: Replay, link: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Relative displacement [m] and velocity [m/s] of a link, and the tension [N] that its laws see."""
    ends = next(item for item in run.model.structure.links if item.name == link)
    still = np.zeros(len(run.response.time))
    x, v = (
        of_body.get(ends.first, still) - of_body.get(ends.second, still)
        for of_body in (run.response.displacement, run.response.velocity)
    )
    held = run.response.tension
    tension = held.get(link, still) if isinstance(held, Mapping) else held
    return x, v, np.maximum(tension, 0.0) if len(tension) else still
