"""The parametric bootstrap of a whole closure: campaigns simulated with the refined model, each closed anew.

Every replicate is a campaign of its own, with the measured hits, and the same closure of it, selection
included; its results stay in ``bootstrap/0001`` and so on, so that a killed run goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.decide.bootstrap import bootstrap_limits
from discovery.views.closure_summary import sections
from experiments.errors import in_words, of_the_input
from experiments.results import plain
from experiments.run.execution import execution
from experiments.run.publication import results_into
from experiments.studies import close
from experiments.studies.figure_files import without_figures
from experiments.studies.identify import Progress
from rom.campaign.campaign import Campaign, CampaignSettings, read_campaign, write_campaign
from rom.campaign.channels import Channel
from rom.campaign.record import replacing
from rom.evaluation.simulated_record import cannot_be_simulated, quiet_part, simulated_record
from rom.model.model import Model
from rom.model_file import load_model
from rom.signals.measured_records import measured_record, stored

FOLDER, MAKING, RESTS_ON, FAILED = "bootstrap", ".making-", "rests-on.json", "failed.json"
_OF_THE_RUN = ("elapsed_s", "command", "versions", "identification", "suspicions", "unfit")
Closer = Callable[[Path, Path], object]
"""Closes the campaign in one folder and leaves ``closure.json`` in another."""


def refuse(campaign_path: Path, count: int) -> None:
    """Refuse a campaign that no model can stand in for, where replicates are asked for.

    Raises
    ------
    ValueError
        A line for every record that cannot be simulated as measured.
    """
    if not count:
        return
    campaign = read_campaign(campaign_path)
    reasons = [cannot_be_simulated(campaign.load(record)) for record in campaign.settings.record]
    if found := [f"--bootstrap: {reason}" for reason in reasons if reason]:
        raise ValueError("\n".join(found))


def run(
    campaign_path: Path,
    folder: Path,
    count: int,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[str], Progress | None] | None = None,
    *,
    model: Path | None = None,
    criteria: Criteria = CRITERIA,
    closer: Closer | None = None,
) -> Path:
    """Add limits from a bootstrap to the closure in a folder.

    Parameters
    ----------
    campaign_path : Path
        The campaign that was closed.
    folder : Path
        Of ``closure.json`` and ``model.json``.
    count : int
        Replicates; those that are there are not made again. With 0 nothing is done.
    seed : int
        Of the closure; each replicate draws from a stream of its own, whatever the number of processes.
    jobs : int
        Replicates at the same time.
    progress : callable, optional
        Takes the name of a stage and returns what takes steps done and steps in all.
    model : Path, optional
        From whose tension law the closure started.
    criteria : Criteria
        The numbers that decide.
    closer : callable, optional
        What closes a replicate, in place of the same closure.

    Returns
    -------
    Path
        Of ``closure.json``.
    """
    path, place = folder / "closure.json", folder / FOLDER
    told = json.loads(path.read_text(encoding="utf-8"))
    if not count or told.get("unfit"):  # what does not describe the records cannot stand in for them
        return path
    again = closer or partial(_closed, seed=seed, model=model, criteria=criteria)
    report = progress("bootstrap") if progress is not None else None
    with results_into(folder) as new:
        _keep_what_belongs(place, _digest(folder / "model.json", told))
        due = [k for k in range(count) if not (place / _name(k)).is_dir()]
        _make(due, count, (campaign_path, folder, seed, again), jobs, report)
        closed = [one for k in range(count) if (one := _replicate(place / _name(k))) is not None]
        told["bootstrap"] = plain(bootstrap_limits(told, closed, count - len(closed), criteria.bootstrap))
        told["summary"] = sections(told)
        text = json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False)
        (new / "closure.json").write_text(text + "\n", encoding="utf-8")
    return path


def _name(number: int) -> str:
    return f"{number + 1:04d}"


def _digest(model: Path, told: Mapping[str, Any]) -> str:
    """Of all that a replicate rests on: the refined model, the records, the seed, the version, criteria."""
    numbers = json.loads(model.read_text(encoding="utf-8"))
    rest = {key: value for key, value in numbers.items() if key not in _OF_THE_RUN}
    of_closure = [told.get(key) for key in ("campaign_digest", "seed", "program_version", "criteria")]
    return hashlib.sha256(json.dumps([rest, of_closure], sort_keys=True).encode()).hexdigest()


def _keep_what_belongs(place: Path, digest: str) -> None:
    """Remove replicates of another closure, half-made ones and those that failed: they are tried again."""
    rests_on = place / RESTS_ON
    known = json.loads(rests_on.read_text(encoding="utf-8")) if rests_on.exists() else None
    if known != digest:
        shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True, exist_ok=True)
    for half in place.glob(f"{MAKING}*"):
        shutil.rmtree(half)
    for failed in place.glob(f"*/{FAILED}"):
        shutil.rmtree(failed.parent)
    with replacing(rests_on) as temporary:
        temporary.write_text(json.dumps(digest), encoding="utf-8")


def _make(
    due: list[int], count: int, of: tuple[Path, Path, int, Closer], jobs: int, progress: Progress | None
) -> None:
    if progress is not None:
        progress(count - len(due), count)
    many = Parallel(n_jobs=min(jobs, max(len(due), 1)), return_as="generator_unordered", batch_size=1)
    for done, _ in enumerate(many(delayed(_make_one)(k, *of) for k in due), count - len(due) + 1):
        if progress is not None:
            progress(done, count)


def _make_one(number: int, campaign_path: Path, folder: Path, seed: int, closer: Closer) -> None:
    """Leave one replicate in a folder that appears whole; a fault is a result too."""
    making = folder / FOLDER / f"{MAKING}{_name(number)}"
    with execution(local="sequential"):
        try:
            stream = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
            model = load_model(folder / "model.json")
            with stored(read_campaign(campaign_path, 1)) as campaign:
                write_simulated(making / "campaign", campaign, model, stream)
            closer(making / "campaign", making)
        except Exception as error:  # the other replicates go on
            if not of_the_input(error):
                shutil.rmtree(making, ignore_errors=True)
                raise
            making.mkdir(parents=True, exist_ok=True)
            (making / FAILED).write_text(json.dumps(in_words(error)), encoding="utf-8")
    shutil.rmtree(making / "campaign", ignore_errors=True)
    making.rename(folder / FOLDER / _name(number))


def _closed(campaign: Path, out: Path, seed: int, model: Path | None, criteria: Criteria) -> None:
    with without_figures():
        close.run(campaign, out, seed, 1, model=model, criteria=criteria)


def write_simulated(folder: Path, campaign: Campaign, model: Model, generator: np.random.Generator) -> None:
    """Write a campaign as a model would have had it measured, with the hits of another.

    Parameters
    ----------
    folder : Path
        Of the new campaign.
    campaign : Campaign
        Whose hits, initial tensions, noise and settings are taken.
    model : Model
        What is simulated.
    generator : numpy.random.Generator
        Draws noise and variability between tests.

    Raises
    ------
    ValueError
        If a simulation does not finish.
    """
    settings: CampaignSettings = campaign.settings
    quiet = [
        quiet_part(campaign.load(one), measured_record(campaign, one).measurement) for one in settings.record
    ]

    def records() -> Iterator[tuple[str, Mapping[str, Channel]]]:
        for one in settings.record:
            measured, raw = measured_record(campaign, one).measurement, campaign.load(one)
            yield one.file, simulated_record(model, raw, measured, settings, quiet, generator)

    write_campaign(folder, settings, records())


def _replicate(place: Path) -> dict[str, Any] | None:
    """The closure of a replicate; None of one that failed."""
    path = place / "closure.json"
    found: dict[str, Any] | None = json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
    return found
