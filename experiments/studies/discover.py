"""A campaign's rival tension laws, ranked by re-simulation: which one the records support, and how surely."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from discovery.criteria.criteria import CRITERIA, Criteria, used_in
from discovery.laws.candidate import ALWAYS_LISTED, NO_LOOSENING, Candidate
from experiments.results import fitted_records, plain, results_folder, write_result
from experiments.run.publication import results_into
from experiments.studies.figure_files import figures_into
from experiments.studies.identify import Progress
from experiments.studies.suspected import screening_of, suspected, write_without_records
from experiments.text.suspicions import suspected_lines
from rom.campaign.campaign import Campaign, CampaignError, read_campaign, read_settings
from rom.signals.measured_records import NothingLeftError, Screening, judged_by, screened, stored
from rom.signals.suspicions import causes

if TYPE_CHECKING:
    from discovery.ranking.result import Ranking

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
    from discovery.ranking.specimens import names_of_bolts

    started = time.perf_counter()
    given = read_laws(laws) if isinstance(laws, Path) else laws or ()
    report = progress or (lambda _: None)
    paths = [campaign_path] if isinstance(campaign_path, Path) else list(campaign_path)
    read = _read(paths, lambda path: read_campaign(path, jobs, report("checking records")), tightening)
    enough(read, paths[0], criteria.ranking.least_cases)
    folder = place_of_results(paths, out)
    digest = digest_of(read)
    header: dict[str, Any] = {"campaign": ", ".join(names_of_bolts(read)), "seed": seed}
    with results_into(folder) as new, ExitStack() as places:
        kept = [judged_by(places.enter_context(stored(one)), criteria.of_records) for one in read]
        campaigns = [screened(one, jobs) for one in kept]
        subject = campaigns[0] if len(campaigns) == 1 else campaigns
        try:
            left_for_laws(campaigns, criteria.ranking.least_cases)
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
        content, told = _content(ranking, campaigns, {"command": command, "campaign_digest": digest}, new)
        header["elapsed_s"] = round(time.perf_counter() - started, 3)
        section = model_section(content) | {"fitted_records": fitted_records(read)}
        ranking.model.save(new / "model.json", **header, **told, identification=section)
        write_result(new / "ranking.json", "ranking", content, **header)
    return folder / "ranking.json"


@contextmanager
def _of_campaign(path: Path, count: int) -> Iterator[None]:
    """Say which of several campaigns a fault is of."""
    try:
        yield
    except CampaignError as error:
        if count == 1:
            raise
        raise CampaignError(f"{path.name}: {line}" for line in error.faults) from None


def _read(paths: Sequence[Path], read: Callable[[Path], Campaign], tightening: bool) -> list[Campaign]:
    """Return campaigns of bolts of one kind; what one line of settings rules out is not read."""
    from discovery.ranking.specimens import check_one_bolt, check_one_kind

    for path in paths:
        with _of_campaign(path, len(paths)):
            check_one_bolt(read_settings(path), path)
    campaigns = []
    for path in paths:
        with _of_campaign(path, len(paths)):
            campaigns.append(read(path))
    check_one_kind(campaigns, tightening)
    return campaigns


def _content(
    ranking: Ranking, campaigns: Sequence[Campaign], asked: dict[str, Any], folder: Path
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what ``ranking.json`` holds, and what of it is suspected; write its figures."""
    from experiments.figures.discovery import discovery_figures

    content = plain(ranking_content(ranking) | asked)
    if len(campaigns) > 1:
        content["campaign_digests"] = [one.digest for one in campaigns]
    told = suspected(campaigns, content["laws"][0]["errors"]["training"])
    content |= told
    content["warnings"] += figures_into(folder, lambda: discovery_figures(content))
    return content, told


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


def left_for_laws(campaigns: Sequence[Campaign], least: float) -> None:
    """Refuse campaigns whose loosening records are too few once suspicions have set some aside.

    Raises
    ------
    NothingLeftError
        With the causes.
    """
    left = 0
    lost: list[tuple[Campaign, Screening]] = []
    for campaign in campaigns:
        screening = screening_of(campaign)
        training = {r.file for r in campaign.select("loosening") if not r.hold_out}
        left += len(training - screening.doubts.keys())
        if "loosening" in screening.lost or training & screening.doubts.keys():
            lost.append((campaign, screening))
    gone = next((one for one in lost if "loosening" in one[1].lost), None)
    if gone is None and (left >= least or not lost):
        return
    campaign, screening = gone or lost[0]
    told = "all loosening records set aside, expected some that are not"
    if gone is None:
        told = f"so many loosening records set aside that {left} are left, expected {least:g} or more"
    raise NothingLeftError(
        f"{campaign.path}: found {told}: {'; '.join(causes(screening.suspicions))}", screening
    )


def summary(path: Path) -> str:
    """Return a few lines for people: which law, how sure, what it beats, and the leader board."""
    from discovery.views.ranking_plot import ranked, row_name
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
    left_out = [f"{law['rank']}" for law in laws[_SHOWN:] if law not in later]
    lines += [f"Ranks that are in {path.name} alone: {', '.join(left_out)}."] if left_out else []
    lines += rankings.of_losses(data)
    lines += [f"  note: {text}" for text in data["warnings"] + data["set_aside"]]
    return "\n".join(lines + suspected_lines(data))


def ranking_content(ranking: Ranking) -> dict[str, Any]:
    """Return what ranking.json says, but for its header: the section, and the tests by the laws drawn."""
    from discovery.views.ranking_cases import with_cases
    from discovery.views.ranking_file import ranking_section

    return with_cases(ranking_section(ranking), ranking)


def model_section(content: dict[str, Any]) -> dict[str, Any]:
    """Return what model.json says of how the first law was found: its errors, and those without loosening."""
    from discovery.views.ranking_plot import is_law

    first, floors = content["laws"][0]["errors"], content["laws"][0]["noise_floor"]
    still = next(law["errors"] for law in content["laws"] if is_law(law, NO_LOOSENING))
    return {
        "campaign_digest": content["campaign_digest"],
        "command": content["command"],
        "records": first["training"]["records"],
        "errors": first | {"no_loosening": still},
        "noise_floor": floors,
        "set_aside": content["set_aside"],
        "warnings": content["warnings"],
    }
