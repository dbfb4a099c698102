"""The program `boltlaw`: one command per study."""

from __future__ import annotations

import json
import shlex
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from experiments.errors import INTERRUPTED, UNFIT, a_model, existing, show_warnings_plainly, tell, terminated
from experiments.options import (
    Bootstrap,
    CampaignPath,
    Campaigns,
    Cluster,
    Jobs,
    OneProcess,
    Out,
    Quiet,
    RecordJobs,
    Seed,
    StartModel,
    Unseeded,
)
from experiments.results import results_folder, writable
from experiments.run.execution import execution
from experiments.run.memory import collect_cycles_seldom, return_freed_arrays
from experiments.run.progress import progress_bars
from experiments.studies.experiment import command as experiment_command
from rom.jobs import CORES as _CORES
from rom.provenance import program_version

app = typer.Typer(
    name="boltlaw",
    help="Identify a model of a bolted joint, its tension a state, from impact tests; find what it lacks.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"boltlaw {program_version()}")
        raise typer.Exit


@app.callback()
def _program(
    _version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    pass


@app.command(epilog="Example: boltlaw rig rig-campaign --cases 12 --duration-s 2.5")
def rig(
    new_dir: Annotated[
        Path, typer.Argument(help="Folder to create; the truth goes to NEW_DIR.truth.json beside it.")
    ],
    cases: Annotated[
        int | None,
        typer.Option(min=2, max=10_000, help="Number of preloads; default: the paper's 58, in 200 tests."),
    ] = None,
    noise: Annotated[float, typer.Option(min=0.0, help="Factor on all noise.")] = 1.0,
    scatter: Annotated[
        float, typer.Option(min=0.0, help="Factor on gamma's scatter from test to test.")
    ] = 1.0,
    strengths: Annotated[
        str, typer.Option(help="Loosening hits at each preload, as shares of 1608.7 N, such as 1,0.8,0.6.")
    ] = "1",
    law: Annotated[
        str | None,
        typer.Option(
            help="Tension law that the bolt follows: power-1, power-2, power-3, power-5, constant-quartic, "
            "constant-quadratic, displacement-2, displacement-4, displacement-threshold, path, slip-work, "
            "threshold, threshold-30 or velocity-and-displacement; default: that of the paper."
        ),
    ] = None,
    undeclared: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT[@PLACE][:KEY=VALUE,...]",
            help="Physics or sensor fault not declared in campaign.toml, such as coulomb-friction:F_c=2 or "
            "cubic-stiffness@flexure_so; may be repeated. `python -m experiments.rig` lists them.",
        ),
    ] = None,
    duration_s: Annotated[
        float | None,
        typer.Option(help="Length of a record [s]; default: 30.5 at full scale, 8.5 with --cases."),
    ] = None,
    hold_out_every: Annotated[int, typer.Option(min=0, help="Hold out every n-th preload; 0: none.")] = 5,
    out: Annotated[
        Path | None, typer.Option(help="Folder in which NEW_DIR is created; default: here.")
    ] = None,
    seed: Seed = 0,
    jobs: Jobs = _CORES,
    quiet: Quiet = False,
) -> None:
    """Measure a campaign of raw records on the virtual rig."""
    from experiments.studies import rig as study

    with progress_bars(quiet) as report:
        folder = study.run(
            new_dir if out is None else out / new_dir, cases, noise, seed, jobs, report("measuring"),
            duration_s=duration_s, strengths=study.strengths_from_text(strengths), law=law,
            scatter=scatter, hold_out_every=hold_out_every,
            undeclared=tuple(study.undeclared_from_text(text) for text in undeclared or ()),
        )  # fmt: skip
    _say(f"wrote {folder}", quiet)


@app.command("import", epilog="Example: boltlaw import emps EMPS-files emps-campaign")
def import_(
    name: Annotated[
        str,
        typer.Argument(
            metavar="SET",
            help="Public set: emps, silverbox, tribometer. "
            "Lab files: catman, matlab, uff, tdms, csv, xlsx, json.",
        ),
    ],
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="File or folder as it came; none with --download.")
    ],
    new_dir: Annotated[
        Path | None,
        typer.Argument(metavar="NEW_DIR", help="New campaign; none: drafts a map.", show_default=False),
    ] = None,
    channel_map: Annotated[
        Path | None,
        typer.Option("--map", help="Map of a lab's channels (docs/import.md); default: SOURCE/import.toml."),
    ] = None,
    download: Annotated[
        bool,
        typer.Option("--download", help="Fetch emps or silverbox: boltlaw import emps --download NEW_DIR."),
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder in which NEW_DIR is created; default: here.")
    ] = None,
    seed: Unseeded = 0,  # noqa: ARG001 - every command takes the same options
    jobs: Jobs = _CORES,
    quiet: Quiet = False,
) -> None:
    """Turn a measured data set or a laboratory's files into a campaign folder."""
    from experiments.studies import import_campaign as study

    with progress_bars(quiet) as report:
        moved = report("importing")
        text = study.command(name, source, new_dir, out, channel_map, download, jobs, moved)
    _say(text, quiet)


@app.command(epilog="Example: boltlaw init rig-campaign/records --out drafted")
def init(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder of .h5, .mat or .csv records.", callback=existing)
    ],
    out: Annotated[Path | None, typer.Option(help="Folder for campaign.toml; default: FOLDER.")] = None,
    seed: Unseeded = 0,  # noqa: ARG001 - every command takes the same options
    jobs: OneProcess = _CORES,  # noqa: ARG001
    quiet: Quiet = False,
) -> None:
    """Draft a commented campaign.toml from a folder of records."""
    from experiments.studies import init as study

    path = study.run(folder, out)
    _say(f"wrote {path}; lines with CHECK or NEEDED wait for you, then: boltlaw check", quiet)


@app.command(epilog="Example: boltlaw check rig-campaign")
def check(
    campaign: CampaignPath,
    out: Out = None,
    seed: Unseeded = 0,
    jobs: RecordJobs = _CORES,
    quiet: Quiet = False,
) -> None:
    """Show what was read of a campaign: channels, rates, ranges, doubtful records, figures."""
    from experiments.studies import check as study

    with progress_bars(quiet) as report, execution(None):
        path = study.run(campaign, results_folder(campaign, out), seed, jobs, report("checking"), _command())
    _finish(path, study.summary(path), " and figures beside it", quiet)


@app.command(epilog="Example: boltlaw identify rig-campaign")
def identify(
    campaign: CampaignPath,
    out: Out = None,
    seed: Unseeded = 0,
    jobs: RecordJobs = _CORES,
    cluster: Cluster = None,
    quiet: Quiet = False,
) -> None:
    """Identify the model of a campaign: links, k_C(T), c_C(T), gamma per case and gamma(T)."""
    from experiments.studies import identify as study

    with progress_bars(quiet) as report, execution(cluster):
        path = study.run(campaign, results_folder(campaign, out), seed, jobs, report, _command())
    _finish(path, study.summary(path), " and figures beside it", quiet)


@app.command(epilog="Example: boltlaw reproduce --cases 8 --out reproduction")
def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("reproduction"),
    cases: Annotated[
        int | None, typer.Option(min=8, max=10_000, help="Number of preloads; default: the paper's 58.")
    ] = None,
    seed: Seed = 0,
    jobs: Jobs = _CORES,
    cluster: Cluster = None,
    quiet: Quiet = False,
) -> None:
    """Set the paper's printed numbers beside ours, on its campaign as measured by the virtual rig."""
    from experiments.studies import reproduce as study

    with progress_bars(quiet) as report, execution(cluster):
        path = study.run(writable(out), cases, seed, jobs, report, _command())
    _finish(path, study.summary(path), " and figures beside it", quiet)


@app.command(epilog="Example: boltlaw discover rig-campaign")
def discover(
    campaign: Campaigns,
    tightening: Annotated[
        bool,
        typer.Option("--tightening", help="Also try laws that tighten, and keep records whose tension rose."),
    ] = False,
    laws: Annotated[
        Path | None,
        typer.Option(metavar="LAWS.toml", help="Laws of your own that run among all candidates."),
    ] = None,
    library: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Search only this library of factors, such as velocity; may be repeated. An unknown name "
            "lists all.",
        ),
    ] = None,
    optimizer: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Use only this optimizer, such as STLSQ; may be repeated. An unknown name lists all.",
        ),
    ] = None,
    max_terms: Annotated[int | None, typer.Option(min=1, help="Terms of a law, at most; default: 3.")] = None,
    out: Out = None,
    seed: Seed = 0,
    jobs: Jobs = _CORES,
    cluster: Cluster = None,
    quiet: Quiet = False,
) -> None:
    """Rank rival tension laws by re-simulation: which one the records support, and how surely."""
    from experiments.studies import discover as study

    with progress_bars(quiet) as report, execution(cluster):
        path = study.run(
            campaign, out, seed, jobs, report, _command(), tightening=tightening, laws=laws,
            libraries=library, optimizers=optimizer, max_terms=max_terms,
        )  # fmt: skip
    _finish(path, study.summary(path), ", the first law's model.json and figures beside it", quiet)


@app.command(epilog="Example: boltlaw compare rig-campaign laws.toml")
def compare(
    campaign: Campaigns,
    laws: Annotated[Path, typer.Argument(metavar="LAWS.toml", help="Laws of your own.", callback=existing)],
    tightening: Annotated[
        bool, typer.Option("--tightening", help="Keep records whose tension rose.")
    ] = False,
    out: Out = None,
    seed: Seed = 0,
    jobs: Jobs = _CORES,
    cluster: Cluster = None,
    quiet: Quiet = False,
) -> None:
    """Rank laws of your own beside gamma(T), constant gamma and no loosening, as discover ranks its laws."""
    from experiments.studies import discover as study

    with progress_bars(quiet) as report, execution(cluster):
        path = study.run(
            campaign, out, seed, jobs, report, _command(), tightening=tightening, laws=laws, given_only=True
        )
    _finish(path, study.summary(path), ", the first law's model.json and figures beside it", quiet)


@app.command(epilog="Example: boltlaw close rig-campaign")
def close(
    campaign: CampaignPath,
    model: StartModel = None,
    bootstrap: Bootstrap = 0,
    out: Out = None,
    seed: Seed = 0,
    jobs: Jobs = _CORES,
    cluster: Cluster = None,
    quiet: Quiet = False,
) -> None:
    """Trace what the model leaves to a missing effect, add it, and report the errors before and after."""
    from experiments.studies import bootstrap as replicates
    from experiments.studies import close as study

    replicates.refuse(campaign, bootstrap)
    with progress_bars(quiet) as report, execution(cluster):
        path = study.run(campaign, results_folder(campaign, out), seed, jobs, report, _command(), model=model)
        replicates.run(campaign, path.parent, bootstrap, seed, jobs, report, model=model)
    _finish(path, study.summary(path), ", the refined model.json and figures beside it", quiet)


experiment_command.add_to(app)


@app.command(epilog="Example: boltlaw predict rig-campaign-results/model.json rig-campaign")
def predict(
    model: Annotated[Path, typer.Argument(help="A model.json.", callback=a_model)],
    campaign: CampaignPath,
    out: Out = None,
    seed: Unseeded = 0,
    jobs: RecordJobs = _CORES,
    cluster: Cluster = None,
    quiet: Quiet = False,
) -> None:
    """Simulate every record of a campaign with a model; nothing is fitted."""
    from experiments.studies import predict as study

    with progress_bars(quiet) as report, execution(cluster):
        path = study.run(
            model, campaign, results_folder(campaign, out), seed, jobs, report("simulating"), _command()
        )
    _finish(path, study.summary(path), "", quiet)


@app.command(epilog="Example: boltlaw report rig-campaign-results")
def report(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder with result files.", callback=existing)
    ],
    out: Annotated[Path | None, typer.Option(help="Folder for report.html; default: DIR.")] = None,
    seed: Unseeded = 0,  # noqa: ARG001 - every command takes the same options
    jobs: OneProcess = _CORES,  # noqa: ARG001
    quiet: Quiet = False,
) -> None:
    """Make one self-contained page of the result files in a folder."""
    from experiments.studies import report as study

    _say(f"wrote {study.run(folder, out)}", quiet)


def main() -> None:
    """Exit with code 0: done, 3: done, but no model is good, 2: bad input, 1: a fault of the program."""
    return_freed_arrays()
    collect_cycles_seldom()
    show_warnings_plainly()
    signal.signal(signal.SIGTERM, terminated)
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code; faults of the input go to standard error, a line each."""
    try:
        result = typer.main.get_command(app).main(arguments, prog_name="boltlaw", standalone_mode=False)
    except (Exception, KeyboardInterrupt) as error:
        return tell(error)
    if result == INTERRUPTED:  # the command line library keeps the exception to itself
        return tell(KeyboardInterrupt())
    return result if isinstance(result, int) else 0


def _say(text: str, quiet: bool) -> None:
    if not quiet and text:
        print(text)


def _finish(path: Path, summary: str, beside: str, quiet: bool) -> None:
    """Say what was found and written; an exit code of its own and one line where no model is good."""
    _say(summary, quiet)
    _say(f"wrote {path}{beside if any(path.parent.rglob('*.svg')) else ''}", quiet)
    if unfit := json.loads(path.read_text(encoding="utf-8")).get("unfit"):
        print(unfit, file=sys.stderr)
        raise typer.Exit(UNFIT)


def _command() -> str:
    return shlex.join(["boltlaw", *sys.argv[1:]])


if __name__ == "__main__":
    main()
