"""Options whose default follows from the campaign."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path

import pytest
from typer import Typer
from typer.testing import CliRunner

import discovery
import rom
from experiments import options
from experiments.options import CampaignPath, Cluster, RecordJobs
from rom import jobs
from tests.rom.sound_campaign import write_sound_campaign

app = Typer()


@app.command()
def command(campaign: CampaignPath, jobs: RecordJobs = 8, cluster: Cluster = None) -> None:
    print(campaign.name, jobs, cluster)


def test_few_records_take_one_process_where_none_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_sound_campaign(tmp_path / "campaign")

    def said(*arguments: str) -> str:
        return CliRunner().invoke(app, [*arguments, str(tmp_path / "campaign")]).stdout.strip()

    monkeypatch.setattr(options, "CORES", 8)
    monkeypatch.setattr(jobs, "CORES", 8)
    assert said() == "campaign 1 None"
    assert said("--jobs", "3") == "campaign 3 None"
    assert said("--cluster", "tcp://host:1") == "campaign 8 tcp://host:1"
    monkeypatch.setattr(jobs, "_FEW_BYTES", 10_000)
    assert said() == "campaign 8 None"


@pytest.mark.parametrize("work", [rom.identify, discovery.discover, discovery.compare, discovery.close_loop])
def test_python_and_the_commands_use_all_cores_by_default(work: Callable[..., object]) -> None:
    assert inspect.signature(work).parameters["jobs"].default is None
