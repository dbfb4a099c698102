"""A campaign's rival tension laws, ranked by re-simulation: which one the records support, and how surely."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discovery.criteria.criteria import CRITERIA, Criteria, used_in
from discovery.laws.candidate import ALWAYS_LISTED, NO_LOOSENING, Candidate
from experiments.results import plain, results_folder, write_result
from experiments.run.publication import results_into
from experiments.studies.identify import Progress, save_figures, suspected_lines
from experiments.studies.suspected import screening_of, suspected, write_without_records
from rom.campaign.campaign import Campaign, read_campaign, read_settings
from rom.campaign.channels import FloatArray
from rom.signals.measured_records import NothingLeftError, judged_by, screened, stored
from rom.signals.suspicions import causes
from rom.signals.tension_bins import TensionCourse

if TYPE_CHECKING:
    from discovery.ranking.result import RankedLaw, Ranking
    from rom.model.model import Model

NO_RANKING: Mapping[str, Any] = {
    "laws": [],
    "considered": 0,
    "exponent_profile": {"values": [], "delta_bic": []},
}
_SHOWN = 8  # laws in the summary


def run(
    campaign_path: Path | Sequence[Path],
    out: Path | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[str], Progress | None] | None = None,
    command: str = "",
    *,
    tightening: bool = False,
    laws: Path | Sequence[Candidate] | None = None,
    given_only: bool = False,
    libraries: Sequence[str] | None = None,
    optimizers: Sequence[str] | None = None,
    max_terms: int | None = None,
    criteria: Criteria = CRITERIA,
    then: Callable[[Ranking], None] = lambda _: None,
) -> Path:
    """Write ``ranking.json``, ``model.json`` with the first law, and the figures; return the ranking's path.

    Parameters
    ----------
    campaign_path : Path or sequence of Path
        Folder of the campaign, or those of several bolts of one kind.
    out : Path, optional
        Folder of the results; beside the campaign if not given, as `place_of_results`.
    seed : int
        Of all that is drawn.
    jobs : int
        Processes.
    progress : callable, optional
        Takes the name of a stage and returns what takes steps done and steps in all.
    command : str
        The command line, kept in the result file.
    tightening : bool
        Whether records whose tension rose are used too.
    laws : Path or sequence of Candidate, optional
        Laws of one's own that are in the race, or a file of them (`discovery.laws.law_file`).
    given_only : bool
        Whether these and the standing laws are all.
    libraries, optimizers : sequence of str, optional
        Names in `discovery.LIBRARIES` and `discovery.OPTIMIZERS`; all if not given.
    max_terms : int, optional
        Terms of a law, at most.
    criteria : Criteria
        The numbers that decide.
    then : callable
        Takes the ranking before it is written.

    Returns
    -------
    Path
        Of ``ranking.json``.

    Raises
    ------
    ValueError
        If the campaign or the laws cannot be used, or there are too few loosening records to compare laws.
    """
    import discovery
    from discovery.laws.law_file import read_laws
    from discovery.ranking.specimens import check_one_bolt, check_one_kind, names_of_bolts
    from experiments.figures.discovery import discovery_figures

    started = time.perf_counter()
    given = read_laws(laws) if isinstance(laws, Path) else laws or ()
    report = progress or (lambda _: None)
    paths = [campaign_path] if isinstance(campaign_path, Path) else list(campaign_path)
    for path in paths:
        check_one_bolt(read_settings(path), path)
    read = [read_campaign(path, jobs, report("checking records")) for path in paths]
    check_one_kind(read, tightening)
    enough(read, paths[0], criteria.ranking.least_cases)
    folder = place_of_results(paths, out)
    digest = digest_of(read)
    header: dict[str, Any] = {"campaign": ", ".join(names_of_bolts(read)), "seed": seed}
    with results_into(folder) as new, ExitStack() as places:
        kept = [judged_by(places.enter_context(stored(one)), criteria.of_records) for one in read]
        campaigns = [screened(one, jobs) for one in kept]
        subject = campaigns[0] if len(campaigns) == 1 else campaigns
        try:
            for campaign in campaigns:
                left_for_laws(campaign)
            if given_only:
                ranking = discovery.compare(subject, given, jobs, report, seed, tightening, criteria)
            else:
                ranking = discovery.discover(
                    subject, jobs, report, seed, tightening, criteria, laws=given, libraries=libraries,
                    optimizers=optimizers, max_terms=max_terms,
                )  # fmt: skip
        except NothingLeftError as nothing:
            header |= {"elapsed_s": time.perf_counter() - started, "command": command}
            header["campaign_digest"] = digest
            write_without_records(new / "ranking.json", "ranking", nothing, NO_RANKING, header)
            return folder / "ranking.json"
        then(ranking)
        content = plain(ranking_content(ranking) | {"command": command, "campaign_digest": digest})
        told = suspected(campaigns, content["laws"][0]["errors"]["training"])
        content |= told
        header["elapsed_s"] = round(time.perf_counter() - started, 3)
        ranking.model.save(new / "model.json", **header, **told, identification=model_section(content))
        write_result(new / "ranking.json", "ranking", content, **header)
        save_figures(discovery_figures(content), new)
    return folder / "ranking.json"


def place_of_results(paths: Sequence[Path], out: Path | None) -> Path:
    """Return where results go: `out`, or beside the campaign; of several beside the first, with their number.

    Raises
    ------
    OSError
        If nothing can be written there.
    """
    first, more = paths[0].resolve(), len(paths) - 1
    folder = first.parent if first.is_file() else first
    return results_folder(folder.with_name(f"{folder.name}-and-{more}-more") if more else paths[0], out)


def digest_of(campaigns: Sequence[Campaign]) -> str:
    """Return the digest of a campaign, or one of the digests of several."""
    if len(campaigns) == 1:
        return campaigns[0].digest
    return hashlib.sha256("\n".join(one.digest for one in campaigns).encode()).hexdigest()


def enough(campaigns: Sequence[Campaign], path: Path, least: float) -> None:
    """Refuse campaigns whose loosening records are too few to compare laws.

    Parameters
    ----------
    campaigns : sequence of Campaign
        As they were read.
    path : Path
        As the first was named.
    least : float
        Loosening records that may be fitted to, at least.

    Raises
    ------
    ValueError
        If there are fewer.
    """
    training = [r for one in campaigns for r in one.select("loosening") if not r.hold_out]
    if len(training) < least:
        raise ValueError(
            f"{path}: found {len(training)} loosening records that are not held out, expected "
            f"{least:g} or more to compare tension laws"
        )


def left_for_laws(campaign: Campaign) -> None:
    """Refuse a campaign all of whose loosening records are set aside.

    Raises
    ------
    NothingLeftError
        With the causes.
    """
    screening = screening_of(campaign)
    if "loosening" in screening.lost:
        raise NothingLeftError(
            f"{campaign.path}: found all loosening records set aside, expected some that are not: "
            f"{'; '.join(causes(screening.suspicions))}",
            screening,
        )


def summary(path: Path) -> str:
    """Return a few lines for people: which law, how sure, what it beats, and the leader board."""
    from discovery.views.ranking_figure import ranked, row_name
    from experiments.text import rankings
    from experiments.text.wording import number, trimmed

    data = json.loads(path.read_text(encoding="utf-8"))
    found = rankings.answer(data)
    lines = [data["campaign"], *([found.verdict, *found.sentences] if found else [])]
    if not data["laws"]:
        return "\n".join([*lines, *suspected_lines(data)])
    lines.append(f"\n{'rank':>4} {'error of loss [%]':>18} {'delta BIC':>10} {'probability':>11}  law")
    laws = ranked(data)
    named = used_in(data).ranking.named
    later = [law for law in laws[_SHOWN:] if law["source"] in ALWAYS_LISTED or law["chosen"] >= named]
    for law in [*laws[:_SHOWN], *later]:
        error = trimmed(number(law["cross_validated_loss_error_percent_median"], 3))
        rise = trimmed(number(law["delta_bic"], 4))
        lines.append(
            f"{law['rank']:>4} {error:>18} {rise:>10} {law.get('probability', 0.0):>11.3f}  {row_name(law)}"
        )
        lines.append(f"{'':>47} dT/dt = {rankings.equation_text(law['equation'])}")
    lines += [f"  note: {text}" for text in data["warnings"] + data["set_aside"]]
    return "\n".join(lines + suspected_lines(data))


def ranking_content(ranking: Ranking) -> dict[str, Any]:
    """Return what ranking.json says, but for its header: the section, and the tests by the laws drawn."""
    from discovery.views.ranking_section import ranking_section
    from experiments.figures.discovery import drawn_laws

    content = ranking_section(ranking)
    return content | {"cases": _case_rows(ranking, drawn_laws(content))}


def _case_rows(ranking: Ranking, names: Sequence[str]) -> list[dict[str, Any]]:
    """Return what every loosening test measured, and its course and loss by the laws of the figures."""
    predicted = {name: _predicted_of_bolts(ranking, ranking[name]) for name in names}
    population = ranking.population
    bolts = [population.bolts[k].name for k in population.of_course] if population else []
    rows = []
    for place, course in enumerate(ranking.courses):
        loss = course.initial - course.final
        middles = 0.5 * (course.edges_s[1:] + course.edges_s[:-1]) - course.impact_s
        rows.append(
            {
                "file": course.file,
                **({"campaign": bolts[place]} if bolts else {}),
                "hold_out": course.hold_out,
                "preload_n": course.preload,
                "initial_tension_n": course.initial,
                "peak_force_n": np.abs(course.force).max(),
                "loss_n": loss,
                "loss_error_n": course.final_error,
                "time_s": middles,
                "change_n": course.change,
                "change_error_n": np.sqrt(np.diag(course.covariance)),
                "laws": {name: means[place][:-1] - course.initial for name, means in predicted.items()},
                "loss_error_percent": {
                    name: 100 * abs((course.initial - means[place][-1]) / loss - 1) if loss else None
                    for name, means in predicted.items()
                },
            }
        )
    return rows


def _predicted_of_bolts(ranking: Ranking, law: RankedLaw) -> list[FloatArray]:
    """Return what `_predicted` does of each test, of several bolts by the model of its own."""
    from discovery.ranking.result import with_law

    population, courses = ranking.population, ranking.courses
    if population is None:
        return _predicted(with_law(ranking.identified, law), courses)
    found: dict[int, FloatArray] = {}
    for bolt in dict.fromkeys(population.of_course):
        places = [place for place, of in enumerate(population.of_course) if of == bolt]
        model = with_law(population.bolts[bolt].model, law)
        found |= dict(zip(places, _predicted(model, [courses[k] for k in places]), strict=True))
    return [found[place] for place in range(len(courses))]


def _predicted(model: Model, courses: Sequence[TensionCourse]) -> list[FloatArray]:
    """Return the mean tensions [N] of each test in its bins, then in its final window, by full simulation."""
    found: dict[int, FloatArray] = {}
    kinds = [(c.body, c.rate_hz, c.tension_rate_hz, len(c.force), len(c.edges_s)) for c in courses]
    for kind in dict.fromkeys(kinds):
        places = [place for place, other in enumerate(kinds) if other == kind]
        chosen = [courses[place] for place in places]
        forces = np.stack([c.force for c in chosen])
        divisor = kind[2] if kind[1] % kind[2] == 0 else None
        initial = np.array([max(c.initial, 0.0) for c in chosen])
        bins, final = (
            model.mean_tensions(
                forces, kind[1], initial, np.stack(edges), body=kind[0], tension_rate_hz=divisor
            )
            for edges in ([c.edges_s for c in chosen], [_final_edges(c) for c in chosen])
        )
        found |= dict(zip(places, np.concatenate([bins, final], axis=1), strict=True))
    return [found[place] for place in range(len(courses))]


def _final_edges(course: TensionCourse) -> FloatArray:
    start, end = course.final_window
    return np.array([start, min(end, len(course.force) / course.rate_hz)])


def model_section(content: dict[str, Any]) -> dict[str, Any]:
    """Return what model.json says of how the first law was found: its errors, and those without loosening."""
    from discovery.views.ranking_figure import is_law

    first = content["laws"][0]["errors"]
    still = next(law["errors"] for law in content["laws"] if is_law(law, NO_LOOSENING))
    return {
        "campaign_digest": content["campaign_digest"],
        "command": content["command"],
        "records": first["training"]["records"],
        "errors": first | {"no_loosening": still},
        "set_aside": content["set_aside"],
        "warnings": content["warnings"],
    }
