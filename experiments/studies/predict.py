"""A model on another campaign: every record simulated, nothing fitted."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from experiments.results import results_folder, write_result
from experiments.studies.identify import errors_by_set
from experiments.studies.suspected import suspected
from experiments.text.suspicions import suspected_lines
from experiments.text.wording import mapping
from rom.campaign.campaign import Campaign, read_campaign
from rom.campaign.checks import file_digest
from rom.evaluation.error_measures import summarise
from rom.evaluation.evaluate import Evaluation, evaluate
from rom.evaluation.noise_floor import floors_by_kind, noise_floor
from rom.model.model import Model
from rom.model_file import ModelFileError, load_model
from rom.signals.measured_records import screened, stored


def run(
    model_path: Path,
    campaign_path: Path,
    out: Path | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> Path:
    """Write ``prediction.json`` and return its path.

    Parameters
    ----------
    model_path : Path
        A file that a model was saved to.
    campaign_path : Path
        Folder of the campaign.
    out : Path, optional
        Folder of the results; beside the campaign if not given.
    seed : int
        Of all that is drawn.
    jobs : int
        Processes.
    progress : callable, optional
        Takes records done and records in all.
    command : str
        The command line, kept in the result file.

    Returns
    -------
    Path
        Of ``prediction.json``.

    Raises
    ------
    ValueError
        If the model or the campaign cannot be used, or the campaign has a body that the model lacks.
    """
    started = time.perf_counter()
    model = load_model(model_path)
    campaign = read_campaign(campaign_path, jobs)
    if (fault := _of_modes(model, campaign)) is not None:
        raise ValueError(f"{campaign_path}: {fault}")
    missing = sorted(set(campaign.settings.body_names) - set(model.structure.body_names))
    if missing:
        known = ", ".join(model.structure.body_names)
        raise ValueError(
            f"{campaign_path}: found the body {missing[0]}, expected those of the model: {known}"
        )
    fitted = _fitted(model_path, campaign)
    with stored(campaign) as work:
        looked_at = screened(work, jobs)
        judged = evaluate([model], looked_at, jobs=jobs, progress=progress, bands="all")
    compared = [_of_set(j, fitted) for j in judged if j.comparisons]
    errors = summarise(j.comparisons[0] for j in compared)
    content = {
        "model": str(model_path),
        "model_digest": file_digest(model_path),
        "command": command,
        "campaign_digest": campaign.digest,
        "fitted_to_this_campaign": None if fitted is None else bool(fitted),
        "errors": errors,
        "noise_floor": noise_floor(j.comparisons[0] for j in compared),
        "sets": {"errors": errors_by_set(compared, 0), "noise_floor": floors_by_kind(compared)},
        "records": [_row(j) for j in compared],
        "set_aside": [f"{d.file}: {d.message}" for j in judged for d in j.doubts],
    }
    content |= suspected(looked_at, errors)
    return write_result(
        results_folder(campaign_path, out) / "prediction.json", "prediction", content,
        campaign=campaign.settings.name, seed=seed, elapsed_s=time.perf_counter() - started,
    )  # fmt: skip


def summary(path: Path) -> str:
    """Return a few lines for people: the errors, how many bands hold, what is suspected."""
    from experiments.text.verdicts import answer

    data = json.loads(path.read_text(encoding="utf-8"))
    found = answer("prediction", data)
    lines = [data["campaign"], *([found.verdict, *found.sentences] if found else [])]
    lines += [f"  set aside: {text}" for text in data["set_aside"]]
    return "\n".join(lines + suspected_lines(data))


def _of_modes(model: Model, campaign: Campaign) -> str | None:
    """Say why a model of modes and a campaign do not belong together, or None."""
    modes = campaign.settings.modes
    if (modes is None) != (model.shapes is None):
        found, expected = ("bodies", "modes") if modes is None else ("[modes]", "bodies")
        return f"found a campaign of {found}, expected one of {expected} as the model has"
    if model.shapes is None:
        return None
    sensors = campaign.load(campaign.settings.record[0]).bodies
    unknown = [sensor for sensor in sensors if sensor not in model.shapes.sensors]
    if unknown:
        return (
            f"found the sensor {unknown[0]}, expected those of the model: {', '.join(model.shapes.sensors)}"
        )
    return None


def _fitted(model_path: Path, campaign: Campaign) -> frozenset[str] | None:
    """Return the files of the records that a model was fitted to; None where its own does not say.

    Records are known by their content: settings may have changed since, or records been added.

    Raises
    ------
    ModelFileError
        If what it says of them is no list.
    """
    found = mapping(json.loads(model_path.read_text(encoding="utf-8")).get("identification"))
    seen = found.get("fitted_records")
    if seen is None:
        return None
    if not isinstance(seen, list):
        raise ModelFileError(
            f"{model_path}: identification.fitted_records: must be a list of digests as a command writes it, "
            "found a value of another kind"
        )
    return frozenset(file for file, digest in campaign.digests.items() if digest in seen)


def _of_set(judged: Evaluation, fitted: frozenset[str] | None) -> Evaluation:
    """Return a record as held out where the fit has not seen it, whatever the campaign says."""
    if fitted is None:
        return judged
    settings = judged.settings.model_copy(update={"hold_out": judged.settings.file not in fitted})
    return replace(judged, settings=settings)


def _row(judged: Evaluation) -> dict[str, Any]:
    found = judged.comparisons[0]
    motion, band = list(found.motion_nrmse.values()), found.band
    noise = [] if found.noise is None else list(found.noise.motion_nrmse.values())
    return {
        "file": found.file,
        "test": found.test,
        "hold_out": judged.settings.hold_out,
        "finished": found.finished,
        "initial_tension_n": found.initial_tension,
        "final_tension_n": {
            "simulated": found.simulated_final,
            "low": band.low,
            "high": band.high,
            "measured": found.measured_final,
        },
        "tension_course_within_band": band.course_within,
        "motion_nrmse": sum(motion) / len(motion) if motion else None,
        "motion_nrmse_of_noise": sum(noise) / len(noise) if noise else None,
        "link_force_nrmse": found.link_force_nrmse,
    }
