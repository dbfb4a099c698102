"""Every code block of README and docs/ runs, page by page, in a folder with a small campaign."""

from __future__ import annotations

import hashlib
import inspect
import re
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import discovery
import rom
import rom.effects
from discovery.criteria.criteria import CRITERIA
from experiments.cli import run
from experiments.studies import rig
from rom.identification.identify import identify_campaign
from rom.model.laws import power_loosening
from tests.discovery.small_searches import FEWER
from tests.documents.blocks import PAGES, REPOSITORY, SHOWN, Block, blocks, carry_out, commands, left_out
from tests.documents.notebooks import prepare
from tests.shared import Shared

Boltlaw = Callable[..., Any]
TUTORIAL = REPOSITORY / "docs" / "tutorial.md"
SLOW = {
    "README.md": "discovers and closes",
    "closed-loop.md": "closes",
    "cluster.md": "identifies",
    "discovery.md": "discovers",
    "experiments.md": "compares laws",
    "own-data.md": "identifies",
    "own-law.md": "identifies and fits",
    "tutorial.md": "goes all the way",
    "what-is-missing.md": "closes",
}
"""Pages that take more than a few seconds, and why."""
IDENTIFYING = (
    "rom.identification.identify",
    "experiments.studies.identify",
    "discovery.ranking.specimens",
    "discovery.loop.impact_refits",
)
_WITHOUT_EFFECT = ("jobs", "progress")  # on the numbers
FEW = 6
"""Preloads of a campaign where a page asks for more. With ``--every`` there are all that it asks for, and as
many laws are fitted in full as for a reader.
"""


def slow(page: Path) -> Any:
    return pytest.param(page, marks=[pytest.mark.slow] if page.name in SLOW else [], id=page.name)


def runs(page: Path) -> list[Block]:
    """The blocks of a page that are carried out."""
    return [block for block in blocks(page) if block.kind not in SHOWN]


def tutorial_commands() -> set[str]:
    """Commands that the tutorial runs: other pages may show them without another run."""
    return {shlex.join(c) for block in blocks(TUTORIAL) if block.kind == "sh" for c in commands(block)}


def once(name: str, work: Callable[..., Any], shared: Shared, *, few: bool) -> Callable[..., Any]:
    """Return a function of a campaign that is carried out once for all pages, whatever the processes."""

    def computed_once(*arguments: Any, **options: Any) -> Any:
        given = inspect.signature(work).bind(*arguments, **options)
        given.apply_defaults()
        if few and given.arguments.get("criteria") == CRITERIA:
            given.arguments["criteria"] = FEWER
        deciding = {key: value for key, value in given.arguments.items() if key not in _WITHOUT_EFFECT}
        if deciding.get("libraries") or deciding.get("optimizers") or name == "compare":
            return work(*given.args, **given.kwargs)  # objects of the page itself: nothing names them
        campaign = deciding.pop("campaign")
        asked = hashlib.sha256(str(sorted(deciding.items())).encode()).hexdigest()[:16]  # a name of a file
        key = f"{name}-{campaign.digest[:16]}-{asked}"
        return shared.once(key, lambda: work(*given.args, **given.kwargs))

    return computed_once


@contextmanager
def few_preloads(config: pytest.Config) -> Iterator[None]:
    """Small campaigns of the virtual rig, hits tried at few tensions: that every line runs is seen too."""
    plain = rig.run

    def run_few(new_dir: Path, cases: int | None = None, *others: Any, **options: Any) -> Path:
        return plain(new_dir, cases and min(cases, FEW), *others, **options)

    with pytest.MonkeyPatch.context() as patch:
        if not config.getoption("every"):
            patch.setattr(rig, "run", run_few)
            patch.setattr("discovery.separating_tests.impacts._PRELOADS", 3)  # at which hits are tried
        yield


@pytest.fixture(scope="session")
def measured(shared: Shared, pytestconfig: pytest.Config) -> Path:
    """The campaign of the tutorial, made once in a run."""
    (words,) = (c for c in map(shlex.split, tutorial_commands()) if c[:2] == ["boltlaw", "rig"])

    def work() -> Path:
        place = shared.new_folder()
        with few_preloads(pytestconfig):
            assert run([*words[1:], "--out", str(place), "--jobs", "1", "--quiet"]) == 0
        return place / words[2]

    return shared.once("tutorial campaign", work)


@pytest.fixture
def place(
    tmp_path: Path, shared: Shared, monkeypatch: pytest.MonkeyPatch, pytestconfig: pytest.Config
) -> Iterator[Path]:
    """A folder to go through a page in. What several pages ask of the same campaign is computed once; what a
    page registers goes with it.
    """
    few = not pytestconfig.getoption("every")
    for name in ("discover", "compare", "close_loop"):
        monkeypatch.setitem(vars(discovery), name, once(name, getattr(discovery, name), shared, few=few))
    identified = once("identify_campaign", identify_campaign, shared, few=few)
    for module in IDENTIFYING:
        monkeypatch.setattr(f"{module}.identify_campaign", identified)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "argv", ["boltlaw"])
    modules, members = set(sys.modules), dict(rom.effects._members)
    with few_preloads(pytestconfig):
        yield tmp_path
    for name in set(sys.modules) - modules:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]
    rom.effects._members.clear()
    rom.effects._members.update(members)


@pytest.mark.parametrize("page", [slow(page) for page in PAGES if runs(page)])
def test_every_block_of_a_page_runs(
    page: Path, place: Path, boltlaw: Boltlaw, request: pytest.FixtureRequest
) -> None:
    """Pages that take a while have the tutorial's campaign, under its name or as ``folder``.

    The tutorial draws the figures of its commands.
    """
    if page.name in SLOW and page != TUTORIAL:
        text = "".join(block.text for block in runs(page))
        for name in ("folder", "rig-campaign"):
            if name in text:
                shutil.copytree(request.getfixturevalue("measured"), place / name)
    prepare(page, place)
    names: dict[str, Any] = {"__name__": "__page__"}
    drawn = page == TUTORIAL or request.config.getoption("every")
    done = tutorial_commands() if page != TUTORIAL else set()
    for block in runs(page):
        carry_out(block, names, partial(boltlaw, figures=drawn), done)


@pytest.mark.slow
@pytest.mark.usefixtures("place")
def test_the_loop_closes_on_what_the_tutorial_hides(measured: Path) -> None:
    """Its closure is that of the pages: computed once."""
    closure = discovery.close_loop(rom.read_campaign(measured))
    assert closure.verdict == "closed"
    (found,) = closure.effects
    assert (found.effect.name, found.effect.enters) == ("cubic-stiffness", "flexure_lo")
    assert found.effect.parameters["k3"].value == pytest.approx(1e9, rel=0.05)
    assert all(one.test for one in found.look_alikes)
    before, after = closure.before["hold_out"], closure.after["hold_out"]
    assert before["motion_nrmse"] is not None
    assert after["motion_nrmse"] is not None
    assert after["motion_nrmse"] < 0.7 * before["motion_nrmse"]
    assert closure.residual_after.total < 1.2 < closure.residual_before.total
    stiffness = closure.model.link_laws["flexure_lo"].stiffness.parameters["k"]
    assert stiffness == closure.refitted["flexure_lo.stiffness.k"]
    assert None not in stiffness.limits


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
