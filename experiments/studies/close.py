"""What a campaign's declared model lacks: the effect, the refined model, errors before and after."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from discovery.criteria.criteria import CRITERIA, Criteria
from experiments.results import fitted_records, plain, results_folder, write_result
from experiments.run.publication import results_into
from experiments.studies.effect_curves import effect_curves
from experiments.studies.figure_files import figures_into
from experiments.studies.identify import Progress
from experiments.studies.suspected import suspected, write_without_records
from experiments.text.suspicions import suspected_lines
from rom.campaign.campaign import Campaign, read_campaign
from rom.evaluation.error_measures import summarise
from rom.model_file import load_model
from rom.signals.measured_records import NothingLeftError, judged_by, screened, stored

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from discovery.loop.result import Closure

_NONE = summarise([])
NO_CLOSURE: Mapping[str, Any] = {
    "verdict": "unexplained",
    "summary": {},
    "effects": [],
    "refitted": [],
    "steps": [],
    "errors": {kind: {"before": _NONE, "after": _NONE} for kind in ("training", "hold_out")},
    "residual": {"before": {}, "after": {}},
    "screened": [],
    "detection_limits": [],
}


def run(
    campaign_path: Path,
    out: Path | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[str], Progress | None] | None = None,
    command: str = "",
    *,
    model: Path | None = None,
    criteria: Criteria = CRITERIA,
    then: Callable[[Closure], None] = lambda _: None,
) -> Path:
    """Write ``closure.json``, ``model.json`` with the refined model, and the figures; return the closure's
    path.

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
    model : Path, optional
        A ``model.json`` whose tension law the loop starts from.
    criteria : Criteria
        The numbers that decide.
    then : callable
        Takes the closure before it is written.

    Returns
    -------
    Path
        Of ``closure.json``.

    Raises
    ------
    ValueError
        If the campaign cannot be used, or the model is none or of another structure.
    """
    import discovery
    from discovery.views.closure_file import closure_section
    from experiments.figures.closure import closure_figures

    started = time.perf_counter()
    report = progress or (lambda _: None)
    before = None if model is None else load_model(model)
    campaign = read_campaign(campaign_path, jobs, report("checking records"))
    folder = results_folder(campaign_path, out)
    with results_into(folder) as new, stored(campaign) as campaign:
        header: dict[str, Any] = {"campaign": campaign.settings.name, "seed": seed}
        campaign = screened(judged_by(campaign, criteria.of_records), jobs)
        try:
            closure = discovery.close_loop(campaign, jobs, report, seed, criteria=criteria, model=before)
        except NothingLeftError as nothing:
            header |= {"elapsed_s": time.perf_counter() - started, "command": command}
            header["campaign_digest"] = campaign.digest
            write_without_records(new / "closure.json", "closure", nothing, NO_CLOSURE, header)
            return folder / "closure.json"
        then(closure)
        curves = effect_curves(closure.model, [found.effect for found in closure.effects], campaign)
        content = plain(closure_section(closure) | {"command": command, "campaign_digest": campaign.digest})
        for row, curve in zip(content["effects"], curves, strict=True):
            row["curve"] = plain(curve)
        told = suspected(campaign, content["errors"]["training"]["after"], closed=True)
        content |= told
        content["warnings"] += figures_into(
            new,
            lambda: closure_figures(content),
            lambda: _records(closure, campaign, report("drawing records")),
        )
        header["elapsed_s"] = round(time.perf_counter() - started, 3)
        section = model_section(content) | {"fitted_records": fitted_records([campaign])}
        closure.model.save(new / "model.json", **header, **told, identification=section)
        write_result(new / "closure.json", "closure", content, **header)
    return folder / "closure.json"


def _records(closure: Closure, campaign: Campaign, progress: Progress | None) -> dict[str, Figure]:
    """Return records by the declared and by the refined model, to choose from on the page."""
    from experiments.figures.courses import chosen_records, record_figures
    from experiments.figures.identification import CHOICES, example_records

    if closure.declared is None:
        return {}
    models = {"Declared model": closure.declared}
    if closure.effects:
        models |= {"Refined model": closure.model}
    aside = [line.partition(":")[0] for line in closure.set_aside]
    shown = example_records(campaign, CHOICES, aside)
    return dict(chosen_records("closure-records", record_figures(shown, models, progress)))


def model_section(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return what model.json says of how the refined model was found: its errors."""
    after = {kind: errors["after"] for kind, errors in content["errors"].items()}
    return {
        "campaign_digest": content["campaign_digest"],
        "command": content["command"],
        "records": after["training"]["records"],
        "errors": after,
        "noise_floor": content["noise_floor"],
        "set_aside": content["set_aside"],
        "warnings": content["warnings"],
    }


def summary(path: Path) -> str:
    """Return a few lines for people: the verdict, what was missing, how one knows, what remains."""
    from experiments.text.verdicts import answer

    data = json.loads(path.read_text(encoding="utf-8"))
    found = answer("closure", data)
    lines = [data["campaign"], *([found.verdict] if found else []), *data["summary"].values()]
    lines += [f"  note: {text}" for text in data["warnings"] + data["set_aside"]]
    return "\n".join(lines + suspected_lines(data))
