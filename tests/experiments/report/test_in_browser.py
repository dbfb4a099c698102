"""The report in headless Chromium: no fault, the numbers of the files, no sideways scroll, one click."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from experiments.figures.closure import closure_figures
from experiments.figures.discovery import discovery_figures
from experiments.studies import report
from experiments.studies.identify import save_figures
from rom.parameters.he_2025 import paper_model
from tests.discovery.sound_closure import closure, friction, threshold
from tests.experiments.browser import CHROMIUM, Page, browser
from tests.experiments.report.test_closure import content, curves
from tests.experiments.report.test_report import errors, identification, write
from tests.experiments.sound_ranking import ranking

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
LONG = "_".join(["a_name_without_a_blank"] * 8)
PHONE, DESKTOP, PAPER = 390, 1200, 718  # [px]; A4 less its margins
HEADLINES = ("motion_nrmse", "relative_motion_nrmse", "tension_loss_error_percent_median")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of every command, with a long name and a hostile one, and their figures."""
    made = tmp_path_factory.mktemp("everything")
    found = content(closure(friction(), threshold()), *curves()[:2])
    write(made, "closure", **found)
    write(made, "ranking", **ranking())
    write(made, "prediction", errors=errors(1.0), records=[{"file": f"{LONG}.h5", "motion_nrmse": 0.1}])
    about = identification() | {"warnings": [f"{LONG}.h5: <img src=x onerror=alert(1)>"]}
    paper_model().save(made / "model.json", campaign=LONG, seed=7, elapsed_s=12.5, identification=about)
    save_figures(closure_figures(found) | discovery_figures(ranking()), made)
    report.run(made)
    return made


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


def reach(page: Page) -> float:
    """Return how far the page can be scrolled sideways [px]."""
    return float(page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth"))


def test_no_fault_and_the_headlines_are_those_of_the_file(folder: Path, page: Page) -> None:
    page.open(folder / "report.html", DESKTOP)
    assert page.faults == []
    shown = page.evaluate("[...document.querySelector('.answer').querySelectorAll('data')].map(d => d.value)")
    after = json.loads((folder / "closure.json").read_text())["errors"]["hold_out"]["after"]
    assert [float(value) for value in shown] == [after[key] for key in HEADLINES]


@pytest.mark.parametrize("width", [PHONE, DESKTOP])
def test_nothing_scrolls_sideways(folder: Path, page: Page, width: int) -> None:
    page.open(folder / "report.html", width)
    assert page.evaluate("innerWidth") == width
    page.evaluate("document.querySelectorAll('details').forEach(part => part.open = true)")
    assert reach(page) == 0


def test_paper_holds_all_of_it(folder: Path, page: Page) -> None:
    page.open(folder / "report.html", PAPER)
    page.media("print")
    wide = page.evaluate(
        "[...document.querySelectorAll('table, math, img, dl')].filter("
        f"part => part.getBoundingClientRect().right > {PAPER} + 1).map(part => part.outerHTML.slice(0, 200))"
    )
    page.media("screen")
    assert wide == []
    assert page.printed().startswith(b"%PDF")


def test_a_click_enlarges_a_figure_and_another_one_closes_it(folder: Path, page: Page) -> None:
    page.open(folder / "report.html", DESKTOP)

    def position() -> Any:
        return page.evaluate("getComputedStyle(document.querySelector('figure')).position")

    def width() -> Any:
        return page.evaluate("document.querySelector('figure img').getBoundingClientRect().width")

    small = width()
    page.evaluate("document.querySelector('figure .enlarge').click()")
    assert position() == "fixed"
    assert width() > small
    page.evaluate("document.querySelector('figure .close').click()")
    assert position() == "static"
    assert page.evaluate("[...document.images].every(image => image.src.startsWith('data:image/svg'))")
