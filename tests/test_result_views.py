"""What people see of results: summaries, tables, figures, a notebook's view; the examples run as printed."""

from __future__ import annotations

import doctest
import importlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rom
from discovery.laws.candidate import rivals_always_in_the_race
from discovery.ranking.result import Ranking
from rom.identification.gamma_per_case import GammaEstimate
from rom.identification.identify import Identification
from rom.identification.joint import JointEstimate
from rom.model.laws import Parameter, constant_damping, constant_stiffness
from rom.model.model import LinkLaws, Model
from rom.model.structure import Body, Link, Structure
from rom.parameters.he_2025 import nominal_impact
from rom.result_views import HasViews
from rom.signals.quality import Doubt
from tests.discovery.sound_closure import closure, friction
from tests.experiments.studies.test_discover import ranked
from tests.rom.sound_campaign import write_sound_campaign

WITH_EXAMPLES = (
    "rom", "rom.campaign.campaign", "rom.model_file", "rom.model.assembly", "discovery.loop.result",
    "discovery.ranking.result", "rom.model.latex", "discovery.search.pysindy_libraries",
)  # fmt: skip


def ranking() -> Ranking:
    laws = tuple(ranked(place, law, {}) for place, law in enumerate(rivals_always_in_the_race(), 1))
    return Ranking(laws, 2000, rom.paper_model(), {})


def identification() -> Identification:
    files = tuple(f"records/coupled_{k}.h5" for k in range(3))
    values = zip(files, (20.0, 150.0, 900.0), (6e5, 2e6, 5e6), (300.0, 900.0, 1700.0), strict=True)
    joint = tuple(JointEstimate(f, t, k, c, (0.01, 0.05), 0.1, "", None, None, None) for f, t, k, c in values)
    gamma = (GammaEstimate("records/loosening_0.h5", 152.7, 140.0, 0.1, 5e7, 0.02, False),)
    doubt = Doubt("records/loosening_1.h5", "force_lo", "clipped", "force_lo is clipped")
    return Identification(
        rom.paper_model(), None, joint=joint, gamma=gamma, set_aside=(doubt,), warnings=("few preloads",),
        records=(*files, "records/loosening_0.h5"),
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("examples")
    write_sound_campaign(place / "campaign")
    return place


@pytest.fixture(scope="module")
def shown(folder: Path) -> dict[str, HasViews]:
    response = rom.paper_model().simulate({"lo": nominal_impact(1600.0, 4800.0, 1.0)}, 4800.0, 60.0)
    return {
        "campaign": rom.read_campaign(folder / "campaign"),
        "model": replace(rom.paper_model(), identification=identification()),
        "identification": identification(),
        "ranking": ranking(),
        "closure": closure(friction()),
        "response": response,
    }


def test_a_campaign_without_preloads_is_drawn_record_by_record(shown: dict[str, HasViews]) -> None:
    campaign = shown["campaign"]
    assert isinstance(campaign, rom.Campaign)
    records = [record.model_copy(update={"preload_n": None}) for record in campaign.settings.record]
    bare = replace(campaign, settings=campaign.settings.model_copy(update={"record": records}))
    (axes,) = bare.plot().axes
    places = [place for drawn in axes.collections for place, _ in drawn.get_offsets()]
    assert sorted(places) == list(range(1, len(records) + 1))
    assert axes.get_xlabel() == "record, in the order of the campaign [1]"


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_run_as_printed(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """But for those of minutes; what these return was made by hand."""
    monkeypatch.chdir(folder)
    names = {"closure": closure(friction()), "ranking": ranking()}
    ran = doctest.testmod(importlib.import_module(name), extraglobs=names, optionflags=doctest.ELLIPSIS)
    assert ran.attempted > 0
    assert ran.failed == 0


@pytest.mark.parametrize(
    ("name", "said", "columns", "panels"),
    [
        ("campaign", "loosening: 1, 0 of them held out, preloads 152.7 to 152.7 N", "test", 1),
        ("model", "1 set aside", "value", 3),
        ("identification", "force_lo is clipped", "gamma_s3_per_m4", 3),
        ("ranking", "First of 2000 candidate laws", "name", 3),
        ("closure", "What was missing: coulomb-friction", "motion_nrmse", None),
        ("response", "tension: 60 N at first", "displacement_so", 2),
    ],
)
def test_every_result_has_words_a_table_a_figure_and_a_notebook_s_view(
    name: str, said: str, columns: str, panels: int | None, shown: dict[str, Any]
) -> None:
    result = shown[name]
    assert said in result.summary()
    assert columns in result.to_frame().columns
    assert len(result.plot().axes) == panels or panels is None
    page = result._repr_html_()
    assert page.count("<pre>") == page.count("</pre>") == 1
    assert "<table" in page
    assert page.count("<tr") < 70  # whatever the length of the table


def test_names_are_text_in_a_notebook_not_markup(folder: Path) -> None:
    campaign = rom.read_campaign(folder / "campaign")
    named = replace(campaign, settings=campaign.settings.model_copy(update={"name": "<b>a & b</b>"}))
    assert "&lt;b&gt;a &amp; b&lt;/b&gt;" in named._repr_html_()


def test_a_model_s_table_holds_every_number_with_its_limits() -> None:
    model = rom.paper_model()
    frame = model.to_frame()
    assert list(frame.index) == list(model.parameters)
    for path, parameter in model.parameters.items():
        assert frame.loc[path, "value"] == parameter.value
        assert frame.loc[path, "unit"] == parameter.unit


def test_a_model_in_words_has_its_effects_and_limits() -> None:
    text = closure(friction()).model.summary()
    assert "coulomb-friction in flexure_lo" in text
    assert "F_c = 0.1 N (95 %: 0.09 to 0.11)" in text


def test_what_was_identified_is_drawn_where_it_was_found() -> None:
    found = identification()
    stiffness, _, loss = found.plot().axes
    np.testing.assert_array_equal(
        stiffness.lines[1].get_xydata(), [(j.tension, j.stiffness) for j in found.joint]
    )
    ((tension, rate),) = np.asarray(loss.lines[1].get_xydata())
    assert tension == 152.7
    assert rate == pytest.approx(5e7 * 0.1**4 * 152.7)


def test_several_bolts_have_a_row_each_and_none_is_refused() -> None:
    paper = rom.paper_model()
    links = (*paper.structure.links, Link("second", "so", "ground", "bolted"))
    twice = replace(
        paper, structure=replace(paper.structure, links=links),
        link_laws={**paper.link_laws, "second": paper.link_laws["joint"]},
    )  # fmt: skip
    assert len(twice.plot().axes) == 6
    spring = LinkLaws(constant_stiffness(1e5), constant_damping(2.0))
    plain = Model(Structure((Body("lo", 1.0),), (Link("spring", "lo", "ground"),)), {"spring": spring})
    with pytest.raises(ValueError, match="found no bolted link, expected one"):
        plain.plot()
    assert "spring: linear" in plain.summary()


def test_a_parameter_without_limits_has_none() -> None:
    from rom.views.model import with_limits

    assert with_limits(Parameter(4.0, "1")) == "4"
    assert with_limits(Parameter(4.0, "N", 3.0, 5.0)) == "4 N (95 %: 3 to 5)"


def test_a_response_prints_short() -> None:
    response = rom.paper_model().simulate({"lo": np.zeros(100)}, rate_hz=19200, initial_tension=300.0)
    assert repr(response) == "Response('ok', 100 samples of lo, so)"
