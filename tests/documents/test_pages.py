"""Every code block of README and docs/ runs, page by page, in a folder with a small campaign."""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import discovery
import rom
import rom.effects
from rom.campaign import Campaign
from rom.laws import power_loosening
from tests.documents.blocks import PAGES, REPOSITORY, SHOWN, Block, blocks, carry_out, commands, left_out
from tests.documents.lab import write_lab
from tests.shared import Shared

Boltlaw = Callable[..., Any]
TUTORIAL = REPOSITORY / "docs" / "tutorial.md"
SLOW = {
    "README.md": "discovers and closes",
    "closed-loop.md": "closes",
    "cluster.md": "identifies",
    "discovery.md": "discovers",
    "own-data.md": "identifies",
    "own-law.md": "identifies and fits",
    "tutorial.md": "goes all the way",
}
"""Pages that take more than a few seconds, and why."""


def slow(page: Path) -> Any:
    return pytest.param(page, marks=[pytest.mark.slow] if page.name in SLOW else [], id=page.name)


def runs(page: Path) -> list[Block]:
    """The blocks of a page that are carried out."""
    return [block for block in blocks(page) if block.kind not in SHOWN]


def tutorial_commands() -> set[str]:
    """Commands that the tutorial runs: other pages may show them without another run."""
    return {shlex.join(c) for block in blocks(TUTORIAL) if block.kind == "sh" for c in commands(block)}


def once(name: str, work: Callable[..., Any], shared: Shared) -> Callable[[Campaign], Any]:
    """Return a function of a campaign that is carried out once for all pages."""
    return lambda campaign: shared.once(f"{name}-{campaign.digest[:16]}", lambda: work(campaign))


@pytest.fixture
def place(
    tmp_path: Path, rig_campaign: Path, shared: Shared, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Path]:
    """A folder as the pages take it for granted: a campaign called ``folder``, a lab's files in ``lab``.

    What several pages ask of the same campaign is computed once. What a page registers goes with it.
    """
    shutil.copytree(rig_campaign, tmp_path / "folder")
    write_lab(rom.read_campaign(rig_campaign), tmp_path / "lab")
    for name in ("discover", "close_loop"):
        monkeypatch.setitem(vars(discovery), name, once(name, getattr(discovery, name), shared))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "argv", ["boltlaw"])
    modules, members = set(sys.modules), dict(rom.effects._members)
    yield tmp_path
    for name in set(sys.modules) - modules:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]
    rom.effects._members.clear()
    rom.effects._members.update(members)


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize("page", [slow(page) for page in PAGES if runs(page)])
def test_every_block_of_a_page_runs(page: Path, boltlaw: Boltlaw) -> None:
    names: dict[str, Any] = {"__name__": "__page__"}
    done = tutorial_commands() if page != TUTORIAL else set()
    for block in runs(page):
        carry_out(block, names, boltlaw, done)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_are_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    targets = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text) + re.findall(r'src="([^"]+)"', text)
    missing = [t for t in targets if "://" not in t and not (page.parent / t).exists()]
    assert missing == []


def test_what_is_left_out_is_a_short_list_of_whole_commands() -> None:
    assert left_out(["make", "test"])
    assert left_out(["python", "-m", "benchmarks.identification", "--seeds", "3"])
    assert left_out(["boltlaw", "make"]) is None
    assert left_out(["python", "-m", "rom.effects"]) is None


def test_theory_shows_the_laws_as_they_are_computed() -> None:
    text = (REPOSITORY / "docs" / "theory.md").read_text(encoding="utf-8")
    joint = rom.paper_model().link_laws["joint"]
    for law in (joint.stiffness, joint.damping, joint.tension_rate, power_loosening(1.0)):
        assert law is not None
        assert f"`{law.equation}`" in text
