"""Every figure that an identification's data allow; what is missing is left out, never an error."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from experiments.figures.curves import (
    calibration_curve,
    first_mode_frequency,
    frequency_responses,
    joint_damping,
    joint_stiffness,
)
from experiments.figures.loosening import REGIME_SPLIT_N, gamma_cases, gamma_law, tension_change
from experiments.figures.style import save
from experiments.figures.tensions import final_tension_errors, overlays, tension_traces
from rom.campaign.campaign import Campaign, WindowSettings
from rom.evaluation.error_measures import Comparison, simulate_measurement
from rom.identification.identify import Identification
from rom.model.assembly import Response
from rom.model.model import Model
from rom.signals.calibration import Calibration
from rom.signals.measured_records import measured_record
from rom.signals.processing import Measurement

CHOICES = {"uncoupled": 4, "coupled": 10, "loosening": 16, "free": 16, "driven": 12, "cycled": 8}
"""Records of each kind of test, at most, from which a reader of the page chooses."""

__all__ = [
    "CHOICES",
    "calibration_curve",
    "example_records",
    "final_tension_errors",
    "first_mode_frequency",
    "frequency_responses",
    "gamma_cases",
    "gamma_law",
    "identification_figures",
    "joint_damping",
    "joint_stiffness",
    "overlays",
    "save",
    "simulated",
    "tension_change",
    "tension_traces",
    "validation_figures",
]


def identification_figures(
    identification: Identification,
    *,
    calibration: Calibration | None = None,
    windows: WindowSettings | None = None,
    examples: Sequence[Measurement] = (),
    split_n: float | None = REGIME_SPLIT_N,
) -> dict[str, Figure]:
    """Return the figures of an identification by name, in the order in which a report shows them.

    Parameters
    ----------
    identification : Identification
        As `identify_campaign` returns it.
    calibration : Calibration
        In place of the model's own coefficients, where covariance and range are known.
    windows : WindowSettings
        The campaign's; without them no tension traces are drawn.
    examples : sequence of Measurement
        Records to show as traces and overlays, as `example_records` chooses them.
    split_n : float
        Initial tension between the two regimes of loosening [N]; None for none.
    """
    model, gamma = identification.model, identification.gamma
    tensions = np.array([*(j.tension for j in identification.joint), *(g.initial for g in gamma)])
    if calibration is None and model.calibration and model.structure.bolted_links:
        calibration = Calibration(tuple(model.calibration))
    joint, uncoupled = identification.joint, identification.uncoupled
    modes = any(j.first_mode is not None for j in joint)
    loosened = any(g.gamma > 0 and not g.at_bound for g in gamma)
    made: dict[str, tuple[object, Callable[[], Figure]]] = {
        "calibration": (calibration, lambda: calibration_curve(_given(calibration), tensions)),
        "frequency-responses": (uncoupled, lambda: frequency_responses(uncoupled)),
        "first-mode-frequency": (modes, lambda: first_mode_frequency(joint, model)),
        "joint-stiffness": (joint, lambda: joint_stiffness(joint, identification.stiffness_fit)),
        "joint-damping": (joint, lambda: joint_damping(joint, identification.damping_fit)),
        "tension-change": (gamma, lambda: tension_change(gamma, split_n)),
        "gamma-cases": (gamma, lambda: gamma_cases(gamma)),
        "gamma-law": (loosened, lambda: gamma_law(gamma, identification.gamma_fit)),
    }
    figures = {name: draw() for name, (there, draw) in made.items() if there}
    return figures | _example_figures(model, examples, windows)


def validation_figures(
    training: Sequence[Comparison],
    hold_out: Sequence[Comparison] = (),
    no_loosening: Sequence[Comparison] = (),
) -> dict[str, Figure]:
    """Return the error of the final tension and of the loss; empty where no loosening record was compared.

    Parameters
    ----------
    training : sequence of Comparison
        Records that were fitted to.
    hold_out : sequence of Comparison
        Records that no fit used.
    no_loosening : sequence of Comparison
        The same records by the model with dT/dt = 0.

    Returns
    -------
    dict of str to Figure
        By name.
    """
    measured = [c for c in (*training, *hold_out) if np.isfinite(c.measured_final) and c.test == "loosening"]
    if not measured:
        return {}
    groups = ([c for c in group if c.test == "loosening"] for group in (training, hold_out, no_loosening))
    return {"final-tension-error": final_tension_errors(*groups)}


def _example_figures(
    model: Model, examples: Sequence[Measurement], windows: WindowSettings | None
) -> dict[str, Figure]:
    figures: dict[str, Figure] = {}
    traced = [m for m in examples if m.tension is not None and m.test == "loosening"]
    if traced and windows is not None:
        figures["tension-traces"] = tension_traces(traced, windows)
    for test in ("coupled", "loosening", "free", "driven"):
        pairs = simulated(model, [m for m in examples if m.test == test and m.motion])
        if pairs:
            figures[f"overlays-{test}"] = overlays(pairs)
    return figures


def simulated(model: Model, measurements: Sequence[Measurement]) -> list[tuple[Measurement, Response]]:
    """Return records with their simulation; records that cannot be simulated or diverge are left out."""
    pairs = []
    for measurement in measurements:
        try:
            response = simulate_measurement(model, measurement)
        except ValueError:
            continue
        if response.status == "ok":
            pairs.append((measurement, response))
    return pairs


def example_records(
    campaign: Campaign, counts: Mapping[str, int] | None = None, leave_out: Sequence[str] = ()
) -> tuple[Measurement, ...]:
    """Process a few records of each kind, spread over the preloads, to be shown (two coupled, six loosening).

    Parameters
    ----------
    campaign : Campaign
        As read by `read_campaign`.
    counts : mapping of str to int
        How many records by kind of test.
    leave_out : sequence of str
        Files not to show, such as those set aside.
    """
    chosen: list[Measurement] = []
    for test, count in (counts or {"coupled": 2, "loosening": 6, "free": 2, "driven": 2}).items():
        records = [record for record in campaign.select(test) if record.file not in leave_out]
        records.sort(key=lambda record: record.preload_n or 0.0)
        places = np.unique(np.linspace(0, len(records) - 1, min(count, len(records))).round().astype(int))
        chosen += [measured_record(campaign, records[place]).measurement for place in places]
    return tuple(chosen)


def _given(calibration: Calibration | None) -> Calibration:
    if calibration is None:
        raise ValueError("a calibration curve needs a calibration, instead got none")
    return calibration
