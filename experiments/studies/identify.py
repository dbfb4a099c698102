"""A campaign into the paper's model, its limits, its errors and its figures."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.results import fitted_records, plain, results_folder
from experiments.run.publication import results_into
from experiments.studies.figure_files import figures_into
from experiments.studies.suspected import suspected, write_without_records
from experiments.text.error_lines import error_line
from experiments.text.limits import parameter_line
from experiments.text.suspicions import suspected_lines
from experiments.text.wording import mapping
from rom.campaign.campaign import Campaign, read_campaign
from rom.evaluation.error_measures import summarise
from rom.evaluation.evaluate import Evaluation, evaluate, without_loosening
from rom.evaluation.noise_floor import floors_by_kind
from rom.identification.gamma_per_case import GammaEstimate
from rom.identification.identify import Identification, identify_campaign
from rom.identification.joint import JointEstimate
from rom.identification.modal_model import IdentifiedMode
from rom.model.laws import Z95, Parameter
from rom.signals.measured_records import NothingLeftError, screened, stored

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from experiments.figures.description import Drawn

Progress = Callable[[int, int], None]
NO_MODEL: Mapping[str, Any] = {"bodies": [], "links": [], "effects": []}


@dataclass(frozen=True, eq=False)
class Outcome:
    """An identification and what its model, and the model without loosening, make of every record."""

    campaign: Campaign
    identification: Identification
    judged: tuple[Evaluation, ...]


def run(
    campaign_path: Path,
    out: Path | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[str], Progress | None] | None = None,
    command: str = "",
) -> Path:
    """Write ``model.json`` and the figures, and return the model's path.

    Parameters
    ----------
    campaign_path : Path
        Folder of the campaign.
    out : Path, optional
        Folder of the results; beside the campaign if not given.
    seed : int
        Of all that is drawn.
    jobs : int
        Processes.
    progress : callable, optional
        Takes the name of a stage and returns what takes steps done and steps in all.
    command : str
        The command line, kept in the result file.

    Returns
    -------
    Path
        Of ``model.json``.

    Raises
    ------
    ValueError
        If the campaign cannot be used.
    """
    started = time.perf_counter()
    report = progress or (lambda _: None)
    campaign = read_campaign(campaign_path, jobs, report("checking records"))
    folder = results_folder(campaign_path, out)
    header: dict[str, Any] = {"campaign": campaign.settings.name, "seed": seed}
    with results_into(folder) as new, stored(campaign) as campaign:
        try:
            outcome = examine(campaign, jobs, report)
        except NothingLeftError as nothing:
            header |= {"elapsed_s": time.perf_counter() - started, "command": command}
            header["campaign_digest"] = campaign.digest
            write_without_records(new / "model.json", "model", nothing, NO_MODEL, header)
        else:
            section = identification_section(outcome) | {"command": command}
            section["warnings"] += figures_into(
                new, lambda: draw(outcome), lambda: draw_records(outcome, report("drawing records"))
            )
            errors = section["errors"]["training"]
            header |= suspected(outcome.campaign, errors, _unexplained(outcome.identification))
            header["elapsed_s"] = round(time.perf_counter() - started, 3)
            outcome.identification.model.save(new / "model.json", **header, identification=plain(section))
    return folder / "model.json"


def examine(
    campaign: Campaign, jobs: int = 1, progress: Callable[[str], Progress | None] | None = None
) -> Outcome:
    """Identify a campaign and judge the model on all of its records.

    Parameters
    ----------
    campaign : Campaign
        What was measured.
    jobs : int
        Processes.
    progress : callable, optional
        Takes the name of a stage and returns what takes steps done and steps in all.

    Returns
    -------
    Outcome
        Identification and errors, with the law and without loosening.
    """
    report = progress or (lambda _: None)
    campaign = screened(campaign, jobs)
    identification = identify_campaign(campaign, jobs, report("identifying"))
    model = identification.model
    models, told = [model, without_loosening(model)], report("simulating")
    return Outcome(campaign, identification, evaluate(models, campaign, None, jobs, told, bands="hold_out"))


def _unexplained(found: Identification) -> list[str]:
    return [one.line for one in found.linear.unexplained] if found.linear is not None else []


def draw(outcome: Outcome) -> dict[str, Figure]:
    """Return the figures that the identification's data allow, by name."""
    from experiments.figures import identification as figures  # matplotlib is loaded when something is drawn

    campaign, found = outcome.campaign, outcome.identification
    drawn = figures.identification_figures(
        found,
        windows=campaign.settings.windows,
        examples=figures.example_records(campaign, leave_out=_doubtful(outcome)),
        split_n=convergence(found.gamma)["split_n"],
    )
    compared = [judged for judged in outcome.judged if judged.comparisons]
    drawn |= figures.validation_figures(
        [j.comparisons[0] for j in compared if not j.settings.hold_out],
        [j.comparisons[0] for j in compared if j.settings.hold_out],
        [j.comparisons[1] for j in compared],
    )
    return drawn


def draw_records(outcome: Outcome, progress: Progress | None = None) -> dict[str, Drawn]:
    """Return records by the identified model, to choose from on the page."""
    from experiments.figures.courses import chosen_records, record_figures
    from experiments.figures.identification import CHOICES, example_records

    shown = example_records(outcome.campaign, CHOICES, _doubtful(outcome))
    models = {"Identified model": outcome.identification.model}
    return chosen_records("records", record_figures(shown, models, progress))


def _doubtful(outcome: Outcome) -> list[str]:
    return [doubt.file for judged in outcome.judged for doubt in judged.doubts]


def identification_section(outcome: Outcome) -> dict[str, Any]:
    """Return what model.json says of how the model was found."""
    found, campaign = outcome.identification, outcome.campaign
    return {
        "campaign_digest": campaign.digest,
        "fitted_records": fitted_records([campaign]),
        "records": len(found.records),
        "set_aside": sorted({f"{d.file}: {d.message}" for j in outcome.judged for d in j.doubts}),
        "warnings": list(found.warnings),
        "errors": errors_by_set(outcome.judged, 0) | {"no_loosening": errors_by_set(outcome.judged, 1)},
        "noise_floor": floors_by_kind(outcome.judged),
        "linear": _linear_rows(found),
        "joint": [_joint_row(estimate) for estimate in found.joint],
        "gamma": [_gamma_row(estimate) for estimate in found.gamma],
        "fits": _fit_rows(found),
        "convergence": convergence(found.gamma),
        **({"modes": [_mode_row(mode) for mode in found.modes]} if found.modes else {}),
    }


def errors_by_set(judged: Iterable[Evaluation], model: int) -> dict[str, Any]:
    """Return the errors of the model at place `model` on training and hold-out records."""
    every = [j for j in judged if j.comparisons]
    return {
        name: summarise(j.comparisons[model] for j in every if j.settings.hold_out is held)
        for name, held in (("training", False), ("hold_out", True))
    }


def convergence(gamma: Iterable[GammaEstimate]) -> dict[str, Any]:
    """Return the tension that best splits the change of tension into two regimes (Fig. 9), and what lies
    above it.

    The split maximises the likelihood of two normal spreads about zero, below and above it.
    """
    cases = sorted(gamma, key=lambda estimate: estimate.initial)
    if len(cases) < 8:
        return {"split_n": None, "largest_loss_above_n": None, "tightening_above": None}
    change = np.array([case.loss for case in cases])
    splits = range(4, len(cases) - 3)
    cost = [
        i * np.log(np.mean(change[:i] ** 2)) + (len(cases) - i) * np.log(np.mean(change[i:] ** 2))
        for i in splits
    ]
    best = splits[int(np.argmin(cost))]
    return {
        "split_n": 0.5 * (cases[best - 1].initial + cases[best].initial),
        "largest_loss_above_n": float(np.abs(change[best:]).max()),
        "tightening_above": int(np.sum(change[best:] < 0)),
        "tightening": int(np.sum(change < 0)),
        "cases": len(cases),
    }


def _linear_rows(found: Identification) -> list[dict[str, Any]]:
    if found.linear is None:
        return []
    return [
        {
            "name": name,
            "value": found.linear.value(name),
            "error_percent": 100 * found.linear.relative_error(name),
        }
        for name in found.linear.names
        if "@" not in name
    ]


def _mode_row(mode: IdentifiedMode) -> dict[str, Any]:
    """Return natural frequency, damping ratio and shape by sensor, each with limits."""

    def row(number: Parameter) -> dict[str, Any]:
        return {"value": number.value, "low": number.low, "high": number.high, "unit": number.unit}

    return {
        "name": mode.name,
        "frequency_hz": row(mode.frequency_hz),
        "damping_ratio": row(mode.damping_ratio),
        "shape": {sensor: row(number) for sensor, number in mode.shape.items()},
    }


def _joint_row(estimate: JointEstimate) -> dict[str, Any]:
    mode = estimate.first_mode
    return {
        "file": estimate.file,
        "tension_n": estimate.tension,
        "stiffness_n_per_m": estimate.stiffness,
        "damping_ns_per_m": estimate.damping,
        "stiffness_error_percent": 100 * estimate.log_errors[0],
        "damping_error_percent": 100 * estimate.log_errors[1],
        "heaviest_damping_ratio": estimate.heaviest_damping_ratio,
        "method": estimate.method,
        "frequency_hz": None if mode is None else mode.frequency.value,
        "damping_ratio": None if mode is None else mode.damping_ratio.value,
        "modal_stiffness_n_per_m": estimate.modal_stiffness,
        "modal_damping_ns_per_m": estimate.modal_damping,
    }


def _gamma_row(estimate: GammaEstimate) -> dict[str, Any]:
    return {
        "file": estimate.file,
        "initial_tension_n": estimate.initial,
        "final_tension_n": estimate.final,
        "loss_error_n": estimate.loss_error,
        "gamma_s3_per_m4": estimate.gamma,
        "gamma_error_percent": 100 * estimate.log_error,
        "at_bound": estimate.at_bound,
    }


def _fit_rows(found: Identification) -> dict[str, Any]:
    fits = {
        "stiffness": found.stiffness_fit,
        "damping": found.damping_fit,
        "gamma per case": found.gamma_case_fit,
        "gamma": found.gamma_fit,
    }
    return {
        name: {
            "law": fit.law.name,
            "r_squared": fit.r_squared,
            "scatter_percent": 100 * fit.scatter,
            "records": len(fit.records),
        }
        for name, fit in fits.items()
        if fit is not None
    }


def summary(path: Path) -> str:
    """Return a few lines for people: what was identified, how well it does on records no fit has seen."""
    data = json.loads(path.read_text(encoding="utf-8"))
    if "identification" not in data:  # no record was left
        return "\n".join([data["campaign"], *suspected_lines(data)])
    section = data["identification"]
    count = "1 training record" if section["records"] == 1 else f"{section['records']} training records"
    lines = [f"{data['campaign']}: {count}, {len(section['set_aside'])} set aside"]
    lines += _masses(data)
    lines += [line for mode in section.get("modes", ()) for line in _of_mode(mode)]
    for link in data["links"]:
        for place in ("stiffness", "damping", "tension_rate"):
            law = link[place]
            if law is not None and law["parameters"]:
                values = ", ".join(_numbers(law["parameters"]))
                head = f"  {link['name']} {place.replace('_', ' ')}: {law['equation']}"
                lines.append(f"{head}   {values}{_records_for(link, place, section['fits'])}")
        lines += _bolt_out(link, data.get("uncoupled_links", ()))
    for name in ("training", "hold_out"):
        errors, rival = section["errors"][name], section["errors"]["no_loosening"][name]
        if errors["records"]:
            floor = mapping(mapping(section.get("noise_floor")).get(name))
            said = error_line(errors, rival, floor)
            lines.append(f"  {name.replace('_', '-')}: {said}")
    lines += [f"  note: {text}" for text in section["warnings"] + section["set_aside"]]
    return "\n".join(lines + suspected_lines(data))


def _numbers(parameters: Mapping[str, Any]) -> Iterator[str]:
    """Yield each number of a law, and which of them were held while others were fitted."""
    fitted = [item["source"] == "identified" for item in parameters.values()]
    for (name, item), own in zip(parameters.items(), fitted, strict=True):
        yield parameter_line(name, item) + (" (held)" if any(fitted) and not own else "")


def _bolt_out(link: Mapping[str, Any], uncoupled: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the stiffness that a link has without the bolt, where that is identified by itself."""
    for other in uncoupled:
        if other["name"] == link["name"] and other["stiffness"] != link["stiffness"]:
            values = ", ".join(parameter_line(*item) for item in other["stiffness"]["parameters"].items())
            yield f"  {link['name']} stiffness, bolt out: {values}"


def _records_for(link: Mapping[str, Any], place: str, fits: Mapping[str, Any]) -> str:
    """Return how many records a law of the joint was fitted to, and for how many free numbers."""
    fit = fits.get({"tension_rate": "gamma"}.get(place, place)) if link["law"] == "bolted" else None
    free = sum(item["low"] is not None for item in link[place]["parameters"].values())
    return "" if fit is None or not free else f"   ({fit['records']} records for {free} free numbers)"


def _masses(data: Mapping[str, Any]) -> list[str]:
    """Return a line for each mass, with 95 % limits where it was identified."""
    rows = {row["name"]: row["error_percent"] for row in data["identification"]["linear"]}
    lines = []
    for body in data["bodies"]:
        mass, error = body["mass"]["value"], rows.get(f"body.{body['name']}.mass")
        half = None if error is None else Z95 * error / 100 * mass
        limits = " given" if half is None else f" [{mass - half:.4g}, {mass + half:.4g}]"
        lines.append(f"  {body['name']} mass: {mass:.5g} kg{limits}")
    return lines


def _of_mode(mode: Mapping[str, Any]) -> Iterator[str]:
    """Yield what modal analysis reports of a mode, and its shape."""
    numbers = (parameter_line("f", mode["frequency_hz"]), parameter_line("zeta", mode["damping_ratio"]))
    yield f"  {mode['name']}: {', '.join(numbers)}"
    yield "    shape: " + ", ".join(parameter_line(sensor, item) for sensor, item in mode["shape"].items())
