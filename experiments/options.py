"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.errors import a_campaign, a_model, campaigns
from rom.jobs import CORES, processes_for

CampaignPath = Annotated[
    Path, typer.Argument(help="Campaign folder: campaign.toml and its records.", callback=a_campaign)
]
Campaigns = Annotated[
    list[Path],
    typer.Argument(
        metavar="CAMPAIGN",
        help="Campaign folder, or those of several bolts of one kind, which share the law.",
        callback=campaigns,
    ),
]
StartModel = Annotated[
    Path | None,
    typer.Option(metavar="MODEL.json", help="Start from the tension law of this model.", callback=a_model),
]
Bootstrap = Annotated[
    int,
    typer.Option(
        metavar="N",
        min=0,
        help="Also close N campaigns simulated with the refined model: limits with bias removed. "
        "A killed run goes on.",
    ),
]
Out = Annotated[
    Path | None, typer.Option(help="Folder for results; default: CAMPAIGN-results beside the campaign.")
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")]
Unseeded = Annotated[int, typer.Option(min=0, help="Accepted by every command; nothing here is random.")]
Jobs = Annotated[
    int, typer.Option(min=1, help="Processes; results do not depend on it.", show_default="all cores")
]
OneProcess = Annotated[
    int,
    typer.Option(
        min=1, help="Accepted by every command; nothing here runs in parallel.", show_default="all cores"
    ),
]
Cluster = Annotated[str | None, typer.Option(help="Address of a Dask scheduler, tcp://host:port.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress and no summary.")]


def _record_jobs(context: typer.Context, jobs: int) -> int:
    """Return one process instead of the default where a campaign's records are few."""
    source = context.get_parameter_source("jobs")
    if (source is not None and source.name != "DEFAULT") or context.params.get("cluster"):
        return jobs
    return min(jobs, _jobs_for_records(context.params["campaign"]))


def _jobs_for_records(campaign: Path) -> int:
    from rom.campaign.campaign import CampaignError, read_settings  # slow to load, and no part of the help

    try:
        files = [record.file for record in read_settings(campaign).record]
    except CampaignError:  # told with all other faults when the records are read
        return CORES
    folder = campaign if campaign.is_dir() else campaign.parent
    return processes_for(None, [folder / file for file in files])


RecordJobs = Annotated[
    int,
    typer.Option(
        min=1,
        help="Processes; results do not depend on it.",
        show_default="all cores; one for records of less than 50 MB",
        callback=_record_jobs,
    ),
]
