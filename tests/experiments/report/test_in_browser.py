"""The report in headless Chromium: no fault, the numbers of the files, no sideways scroll, one click."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib.image as images
import numpy as np
import pytest

from experiments.figures.closure import closure_figures
from experiments.figures.courses import chosen_records, record_figures
from experiments.figures.description import describe
from experiments.figures.discovery import discovery_figures
from experiments.figures.style import panels, save
from experiments.report.interactive import _DESCRIPTION
from experiments.studies import report
from rom.parameters.he_2025 import paper_model
from rom.signals.processing import Measurement
from tests.discovery.sound_closure import closure, friction, threshold
from tests.experiments.browser import CHROMIUM, Page, browser
from tests.experiments.figures.test_description import MODELS
from tests.experiments.figures.test_figures import measurement
from tests.experiments.report.test_closure import content, curves
from tests.experiments.report.test_report import errors, identification, write
from tests.experiments.sound_ranking import ranking

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
LONG = "_".join(["a_name_without_a_blank"] * 8)
PHONE, DESKTOP, PAPER = 390, 1200, 718  # [px]; A4 less its margins
HEADLINES = ("motion_nrmse", "relative_motion_nrmse", "tension_loss_error_percent_median")


@pytest.fixture(scope="module")
def impacts() -> tuple[Measurement, Measurement]:
    """A large and a small one."""
    return measurement(317.0), measurement(3000.0, "coupled", 28.0)


@pytest.fixture(scope="module")
def folder(impacts: tuple[Measurement, Measurement], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of every command, with a long name and a hostile one, and their figures."""
    made = tmp_path_factory.mktemp("everything")
    found = content(closure(friction(), threshold()), *curves()[:2])
    write(made, "closure", **found)
    write(made, "ranking", **ranking())
    write(made, "prediction", errors=errors(1.0), records=[{"file": f"{LONG}.h5", "motion_nrmse": 0.1}])
    about = identification() | {"warnings": [f"{LONG}.h5: <img src=x onerror=alert(1)>"]}
    paper_model().save(made / "model.json", campaign=LONG, seed=7, elapsed_s=12.5, identification=about)
    records = record_figures(impacts, MODELS)
    shown = chosen_records("closure-records", records) | closure_figures(found) | discovery_figures(ranking())
    for name, figure in shown.items():
        save(figure, made / f"{name}.svg")
    figure, axes = panels()
    axes[0, 0].plot([1.0, 2.0, 3.0], [5.0, np.nan, 6.0], label="Line")
    svg = save(figure, made / "gap.svg").read_bytes()
    torn = json.dumps(describe(figure) | {"choices": {"": [{}]}}).replace('"', "&quot;")  # type: ignore[operator]
    (made / "torn.svg").write_bytes(
        _DESCRIPTION.sub(f"<dc:description>{torn}</dc:description>".encode(), svg)
    )
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
    assert (folder / "report.html").stat().st_size < 5e6


def test_the_dot_of_a_derivative_is_seen(folder: Path, page: Page) -> None:
    """As a font has it, it is a pixel of grey; the page's own style makes it twice as dark at least."""
    page.open(folder / "report.html", PHONE)
    dot = "document.querySelector('mover > mo:last-child')"

    def ink() -> float:
        left, top, right, bottom = page.evaluate(
            f"(({{left, top, right, bottom}}) => [left, top, right, bottom])({dot}.getBoundingClientRect())"
        )
        shown = images.imread(io.BytesIO(page.picture()))[..., :3].mean(axis=2)
        shown = shown[int(top) : int(bottom), int(left) : int(right) + 1]
        return float((1 - shown / shown.max()).sum())

    styled = ink()
    page.evaluate(f"{dot}.style.webkitTextStroke = '0'")
    page.evaluate(f"{dot}.style.fontSize = 'revert'")
    assert styled > 2 * ink() > 0


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


@pytest.mark.parametrize("on", [True, False], ids=["scripts", "no scripts"])
def test_a_click_enlarges_a_picture_and_another_one_closes_it(folder: Path, page: Page, on: bool) -> None:
    page.scripting(on=on)
    page.open(folder / "report.html", DESKTOP)
    figure = "document.querySelector('#figure-closure-screened')"

    def position() -> Any:
        return page.evaluate(f"getComputedStyle({figure}).position")

    def width() -> Any:
        return page.evaluate(f"{figure}.querySelector('img').getBoundingClientRect().width")

    small = width()
    page.evaluate(f"{figure}.querySelector('.enlarge').click()")
    assert position() == "fixed"
    assert width() > small
    page.evaluate(f"{figure}.querySelector('.close').click()")
    assert position() == "static"
    assert page.evaluate("[...document.images].every(image => image.src.startsWith('data:image/svg'))")
    page.scripting(on=True)


def test_without_scripts_every_figure_is_a_picture(folder: Path, page: Page) -> None:
    page.scripting(on=False)
    page.open(folder / "report.html", DESKTOP)
    assert page.evaluate(
        "[...document.querySelectorAll('figure img')].every(image => image.offsetWidth > 300)"
    )
    shown = (
        "[...document.querySelectorAll('.live-only, .plot, .legend')].filter(part => part.offsetWidth).length"
    )
    assert page.evaluate(shown) == 0
    page.scripting(on=True)


# What a test asks of a figure's plot: models by name, a button, where values are in the window, tooltips.
_ASK = """(() => {
  const place = document.querySelector('#figure-NAME .plot');
  const root = [...Bokeh.index.roots].find(view => place.contains(view.el));
  const models = [...root.model.references()];
  const named = name => models.find(one => one.name === name && one.type !== 'GlyphRenderer');
  const views = [...root.child_views], bar = views.find(view => view.model.type === 'Toolbar');
  const inner = views.flatMap(view => [...(view.child_views ?? [])]);
  const panel = inner.find(view => view.model.type === 'Figure');
  const button = title => bar.shadow_el.querySelector(`[title='${title}']`);
  const middle = part => {
    const { left, top, width, height } = part.getBoundingClientRect();
    return [left + width / 2, top + height / 2];
  };
  const at = (x, y) => {
    const { left, top } = panel.el.getBoundingClientRect();
    return [left + panel.frame.x_scale.compute(x), top + panel.frame.y_scale.compute(y)];
  };
  const tips = node => [...node.querySelectorAll('*')].flatMap(part => [
    ...(part.matches('.bk-Tooltip') ? [(part.shadowRoot ?? part).textContent] : []),
    ...(part.shadowRoot ? tips(part.shadowRoot) : [])]);
  return VALUE;
})()"""


def until(found: Callable[[], Any]) -> Any:
    """Return what a function returns as soon as it is something."""
    end = time.monotonic() + 60.0
    while not (value := found()):
        assert time.monotonic() < end, "nothing came of it"
        time.sleep(0.05)
    return value


def drawn(page: Page, name: str) -> None:
    """Wait until a figure is drawn as a plot."""
    until(lambda: page.evaluate(f"document.querySelector('#figure-{name}').classList.contains('ready')"))


def read(page: Page, name: str, value: str) -> Any:
    return page.evaluate(_ASK.replace("NAME", name).replace("VALUE", value))


def pointed(page: Page, name: str, x: float, y: float) -> list[str]:
    """Move the mouse onto values of a figure and return the tooltips; before a paint there are none."""
    left, top = read(page, name, f"at({x}, {y})")
    page.point(left - 30, top - 30)
    page.point(left, top)
    return list(read(page, name, "tips(document)"))


@pytest.fixture(params=[PHONE, DESKTOP], ids=["phone", "desktop"])
def plots(folder: Path, page: Page, request: pytest.FixtureRequest) -> Page:
    pytest.importorskip("bokeh", reason="needs Bokeh")
    page.open(folder / "report.html", request.param)
    return page


def test_a_gap_stays_a_gap(plots: Page) -> None:
    plots.evaluate("document.querySelector('#figure-gap .enlarge').click()")
    drawn(plots, "gap")
    assert read(plots, "gap", "named('0.0').data.y.map(Number.isNaN)") == [False, True, False]


def test_a_plot_that_fails_leaves_the_picture(plots: Page) -> None:
    plots.evaluate("document.querySelector('#figure-torn .enlarge').click()")
    until(lambda: plots.evaluate("true") and plots.faults)
    assert plots.evaluate("document.querySelector('#figure-torn img').offsetWidth") > 300
    assert plots.evaluate("document.querySelector('#figure-torn .plot').offsetWidth") == 0
    plots.faults.clear()


def test_an_address_that_cannot_be_decoded_is_no_fault(folder: Path, page: Page) -> None:
    page.open(folder / "report.html", DESKTOP)
    page.evaluate("location.hash = '#%'")
    page.evaluate("new Promise(done => setTimeout(done, 100))")
    assert page.faults == []


def test_a_record_is_chosen_and_drawn(plots: Page, impacts: tuple[Measurement, Measurement]) -> None:
    plots.evaluate("document.querySelector('#figure-closure-records').scrollIntoView()")
    drawn(plots, "closure-records")
    peaks = set()
    for chosen in range(2):
        plots.evaluate(
            "(() => { const chooser = document.querySelector('#figure-closure-records select');"
            f"chooser.selectedIndex = {chosen}; chooser.dispatchEvent(new Event('change')); }})()"
        )
        title = read(plots, "closure-records", "named('title0').text")
        peak = read(plots, "closure-records", "Math.max(...named('0.0').data.y)")
        peaks.add((title, round(peak, 5)))
    assert {title for title, _ in peaks} == {"Displacement of lo [mm]"}
    link = "document.querySelector('#figure-closure-records .enlarge')"  # an empty one shows its focus alone
    assert plots.evaluate(f"{link}.getClientRects().length") == 0
    expected = sorted(1e3 * record.displacement("lo").max() for record in impacts)
    assert sorted(peak for _, peak in peaks) == pytest.approx(expected, rel=2e-3)
    assert plots.faults == []


def test_a_figure_is_zoomed_reset_and_read_under_the_cursor(plots: Page) -> None:
    plots.evaluate("document.querySelector('#figure-law-errors .enlarge').click()")
    drawn(plots, "law-errors")
    ends = "[named('x0').start, named('x0').end, named('y0').start, named('y0').end]"
    whole = read(plots, "law-errors", ends)
    plots.drag(*(read(plots, "law-errors", f"at({x}, {y})") for x, y in ((20, 20), (100, 80), (200, 150))))
    zoomed = read(plots, "law-errors", ends)
    assert zoomed == pytest.approx([20, 200, 20, 150], rel=0.05)
    plots.drag(read(plots, "law-errors", "middle(button('Reset'))"))
    assert until(lambda: read(plots, "law-errors", ends) == pytest.approx(whole))
    number = next(k for k in range(9) if read(plots, "law-errors", f"!!named('0.{k}')?.data.name?.length"))
    x, y, name = read(
        plots, "law-errors", f"(({{x, y, name}}) => [x[0], y[0], name[0]])(named('0.{number}').data)"
    )
    (tip, *_) = until(lambda: pointed(plots, "law-errors", x, y))
    assert name in tip
    assert f"Initial tension: {x:.4g} N" in tip
    assert f"Error of loss: {y:.4g} %" in tip


def test_a_trace_is_hidden_by_its_name(plots: Page) -> None:
    plots.evaluate("document.querySelector('#figure-law-errors .enlarge').click()")
    drawn(plots, "law-errors")
    label = plots.evaluate("document.querySelector('#figure-law-errors .legend button').dataset.label")
    shown = (
        "[...root.model.references()].filter(m => m.type === 'GlyphRenderer' && m.name === "
        f"{json.dumps(label)}).map(m => m.visible)"
    )
    assert set(read(plots, "law-errors", shown)) == {True}
    plots.evaluate("document.querySelector('#figure-law-errors .legend button').click()")
    assert set(read(plots, "law-errors", shown)) == {False}
