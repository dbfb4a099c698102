"""The command ``boltlaw run``."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from experiments.errors import UNFIT, existing
from experiments.options import Cluster, Jobs, Quiet, Unseeded
from experiments.run.execution import execution
from experiments.run.progress import progress_bars
from rom.jobs import CORES


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""

    @app.command("run", epilog="Example: boltlaw run experiment.toml")
    def run(
        experiment: Annotated[
            Path,
            typer.Argument(
                metavar="EXPERIMENT.toml", help="Campaigns, laws, searches, seeds.", callback=existing
            ),
        ],
        out: Annotated[
            Path | None, typer.Option(help="Folder for results; default: EXPERIMENT-results beside the file.")
        ] = None,
        seed: Unseeded = 0,  # noqa: ARG001 - seeds are in the file
        jobs: Jobs = CORES,
        cluster: Cluster = None,
        quiet: Quiet = False,
    ) -> None:
        """Run every cell of an experiment's file once; a second call goes on where the first was stopped."""
        from experiments.studies.experiment import run as study

        with progress_bars(quiet) as report, execution(cluster):
            table = study.run(experiment, out, jobs, report, shlex.join(["boltlaw", *sys.argv[1:]]))
        if not quiet:
            print(table.summary())
            print(f"wrote {table.path}, experiment.csv, a figure, and every cell in cells/ beside it")
        if table.failed:
            first = table.failed[0]
            print(
                f"{len(table.failed)} of {len(table.rows)} cells failed, the first of them "
                f"{first['command']} of {first['campaign']}: {first['message']}",
                file=sys.stderr,
            )
            raise typer.Exit(UNFIT)
