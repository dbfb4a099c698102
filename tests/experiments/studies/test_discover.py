"""`boltlaw discover`: what it writes, what it refuses, and the plain words that it prints."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from discovery.courses.fit import Fit, Uncertainty
from discovery.laws.candidate import BASELINE, Candidate, rivals_always_in_the_race
from discovery.ranking.confidence_sets import ExponentProfile, MotionProfile
from discovery.ranking.population import Bolt, Limited, Population
from discovery.ranking.result import RankedLaw, Ranking
from discovery.ranking.specimens import check_one_kind
from discovery.separating_tests.impacts import Proposal
from experiments.report.comparisons import comparison_tables
from experiments.report.results import read_results
from experiments.results import fitted_records
from experiments.studies import discover
from rom.campaign.campaign import read_campaign, read_settings
from rom.evaluation.noise_floor import noise_floor
from rom.model_file import load_model
from rom.parameters.he_2025 import nominal_impact, paper_model
from rom.signals.tension_bins import TensionCourse
from tests.conftest import Ran
from tests.experiments.sound_ranking import errors
from tests.rom.sound_campaign import write_sound_campaign

Boltlaw = Callable[..., Any]
RATE_HZ = 4800.0
LAWS = """format = "boltlaw-laws/1"
[[law]]
name = "slip work"
rate = "-a * abs(D * v) * max(T, 0)"
parameters = { a = { value = 1.0, unit = "1/J" } }
"""
CONTRACT_LAW = {
    "rank",
    "name",
    "equation",
    "parameters",
    "errors",
    "cross_validated_loss_error_percent_median",
    "delta_bic",
    "wins_against_baseline",
    "p_value_against_baseline",
    "source",
}


def course(preload: float, hold_out: bool = False) -> TensionCourse:
    """A test whose tension fell as the paper's model says, by full simulation."""
    force = nominal_impact(1600.0, RATE_HZ, 2.0)
    edges = np.array([0.5, 0.503, 0.51, 0.6, 1.0, 1.95])
    final = np.array([1.0, 1.95])
    means, last = (
        paper_model().mean_tensions(force[None], RATE_HZ, [preload], e, body="lo")[0] for e in (edges, final)
    )
    return TensionCourse(
        file=f"records/loosening_{preload:g}.h5", hold_out=hold_out, preload=preload, body="lo", force=force,
        rate_hz=RATE_HZ, impact_s=0.5, initial=preload, edges_s=edges, change=means - preload,
        covariance=1e-4 * np.eye(len(edges) - 1), tension_rate_hz=RATE_HZ, final_window=(1.0, 1.95),
        final=float(last[0]), final_error=0.01,
    )  # fmt: skip


def ranked(rank: int, candidate: Candidate, values: dict[str, float]) -> RankedLaw:
    fitted = candidate.with_values(values)
    parameters = {
        name: replace(p, low=0.9 * p.value, high=1.1 * p.value) if name in fitted.free else p
        for name, p in fitted.parameters.items()
    }
    base = candidate.name == BASELINE
    fit = Fit(
        fitted, fitted.free, 0.0, (0.0, 0.0), np.zeros((1, 5)), np.zeros(1), True,
        uncertainty=Uncertainty(np.eye(len(fitted.free)), (0.0, 0.0)),
    )  # fmt: skip
    return RankedLaw(
        rank, candidate.name, fitted.equation, parameters,
        {kind: errors(10.0, 3) for kind in ("training", "hold_out")},
        10.0 * rank, -5.0 * rank, 3.0 * (rank - 1), (0 if base else 3, 5), None if base else float("nan"),
        candidate.source, len(fitted.free), (), fit, fitted, np.zeros(5), 1.0 if rank == 1 else 0.0,
        identified=paper_model(), noise_floor={"hold_out": noise_floor([]) | {"motion_nrmse": 0.0111}},
    )  # fmt: skip


def profile(name: str, reach: Any = "identified") -> ExponentProfile:
    values, law = np.array([3.0, 4.0, 5.0]), rivals_always_in_the_race()[0]
    fit = Fit(law, ("gamma",), 0.0, (0.0, 0.0), np.zeros((20, 5)), np.zeros(20), True)
    deviance = np.array([30.0, 0.5, np.inf])
    return ExponentProfile(name, values, deviance, 3.9, 3.7, 4.2, reach, 1.0, True, fit, ())


@pytest.fixture(scope="module")
def made() -> Ranking:
    rate = paper_model().link_laws["joint"].tension_rate
    assert rate is not None
    paper = {name: p.value for name, p in rate.parameters.items()}
    papers = {"gamma": 10 ** paper["gamma_d"], "gamma_i": paper["gamma_i"], "rho": paper["rho"]}
    candidates = rivals_always_in_the_race()
    laws = tuple(ranked(k, c, papers if c.name == BASELINE else {}) for k, c in enumerate(candidates, 1))
    test = Proposal("lo", 800.0, 0.001, 150.0, 2, (laws[0].name, laws[1].name), 4.0, np.inf)
    return Ranking(
        laws=laws, considered=2000, identified=paper_model(), inclusion={"|v|^n T": 0.9},
        profile=profile("n"), motion_profile=MotionProfile(profile("n"), profile("q", "open below")),
        indistinguishable=(laws[1].name,), proposals=(test,),
        courses=tuple(course(t, t == 100.0) for t in (20.0, 60.0, 100.0, 300.0)),
        set_aside=("records/a.h5: clipped",),
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(made: Ranking, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the command writes for a sound campaign, the ranking itself made by hand."""
    from experiments.cli import run

    place = tmp_path_factory.mktemp("discover")
    write_sound_campaign(place / "campaign")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("discovery.discover", lambda *_, **__: made)
        patch.setattr(discover, "enough", lambda *_: None)
        assert run(["discover", str(place / "campaign"), "--jobs", "1", "--seed", "4", "--quiet"]) == 0
    return place / "campaign-results"


@pytest.mark.parametrize("options", [[], ["--tightening"]])
def test_laws_that_tighten_are_there_on_request(made: Ranking, tmp_path: Path, options: list[str]) -> None:
    from experiments.cli import run

    asked: list[bool] = []

    def found(*arguments: Any, **_: Any) -> Ranking:
        asked.append(arguments[4])
        return made

    write_sound_campaign(tmp_path / "campaign")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("discovery.discover", found)
        patch.setattr(discover, "enough", lambda *_: None)
        assert run(["discover", str(tmp_path / "campaign"), *options, "--jobs", "1", "--quiet"]) == 0
    assert asked == [bool(options)]


def test_libraries_and_optimizers_are_given_by_name(made: Ranking, tmp_path: Path) -> None:
    from experiments.cli import run

    asked: list[dict[str, Any]] = []

    def found(*_: Any, **options: Any) -> Ranking:
        asked.append(options)
        return made

    write_sound_campaign(tmp_path / "campaign")
    named = ["--library", "velocity", "--library", "rate-free", "--optimizer", "STLSQ", "--max-terms", "2"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("discovery.discover", found)
        patch.setattr(discover, "enough", lambda *_: None)
        assert run(["discover", str(tmp_path / "campaign"), *named, "--jobs", "1", "--quiet"]) == 0
    (options,) = asked
    assert options["libraries"] == ["velocity", "rate-free"]
    assert options["optimizers"] == ["STLSQ"]
    assert options["max_terms"] == 2


@pytest.mark.parametrize("command", ["discover", "compare"])
def test_several_campaigns_are_several_bolts_under_one_law(
    made: Ranking, tmp_path: Path, command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from experiments.cli import run

    asked: list[Any] = []

    def found(campaigns: Any, *_: Any, **__: Any) -> Ranking:
        asked.append(campaigns)
        first = Bolt("first", 2, Limited(0.1, -0.2, 0.4), made.laws[0].law, made.model)
        population = Population(
            Limited(0.47, 0.3, 0.9), Limited(0.3, 0.2, float("inf")), 100.0, (first, first), (0, 0, 1, 1)
        )
        return replace(made, population=population)

    for name, factor in (("one", 1.0), ("two", 1.1)):
        write_sound_campaign(tmp_path / name, factor)
    (tmp_path / "laws.toml").write_text(LAWS, encoding="utf-8")
    monkeypatch.setattr(f"discovery.{command}", found)
    monkeypatch.setattr(discover, "enough", lambda *_: None)
    more = ["laws.toml"] if command == "compare" else []
    monkeypatch.chdir(tmp_path)
    assert run([command, "one", "two", *more, "--jobs", "1", "--quiet"]) == 0
    assert [campaign.path.name for campaign in asked[0]] == ["one", "two"]
    data = load(tmp_path / "one-and-1-more-results")
    assert data["population"]["between_bolts"] == {"value": 0.47, "low": 0.3, "high": 0.9}
    assert data["population"]["between_tests"]["high"] is None
    assert data["campaign"] == "one, two"  # both have one name
    assert [case["campaign"] for case in data["cases"]] == ["first"] * 4
    assert "Between 2 bolts ln(rate) has a standard deviation of 0.47" in discover.summary(
        tmp_path / "one-and-1-more-results" / "ranking.json"
    )


def test_two_bolts_in_a_structure_are_refused_before_records_are_read(
    tmp_path: Path, boltlaw: Boltlaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("records were read")

    write_sound_campaign(tmp_path / "one")
    toml = tmp_path / "one" / "campaign.toml"
    toml.write_text(toml.read_text() + '[[link]]\nname = "lap"\nbetween = ["so", "ground"]\nlaw = "bolted"\n')
    monkeypatch.setattr(discover, "read_campaign", never)
    ran = boltlaw("discover", tmp_path / "one", "--jobs", 1)
    assert (ran.code, ran.out) == (2, "")
    (line,) = ran.err.splitlines()
    assert "found 2 bolted links (joint, lap), expected one" in line
    read: Any = SimpleNamespace(path=tmp_path, settings=read_settings(tmp_path / "one"))
    with pytest.raises(ValueError, match="2 bolted links"):
        check_one_kind([read])


def test_the_same_campaign_twice_is_refused(tmp_path: Path, boltlaw: Boltlaw) -> None:
    write_sound_campaign(tmp_path / "one")
    ran = boltlaw("discover", tmp_path / "one", tmp_path / "one", "--jobs", 1)
    assert (ran.code, ran.out) == (2, "")
    (line,) = ran.err.splitlines()
    assert line.endswith("found loosening records of another campaign, expected its own")


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("--library", "expected one of: polynomials; velocity;"),
        ("--optimizer", "expected one of: FROLS; SSR;"),
    ],
)
def test_a_name_that_is_none_lists_all(
    option: str, said: str, tmp_path: Path, boltlaw: Boltlaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_sound_campaign(tmp_path / "campaign")
    monkeypatch.setattr(discover, "enough", lambda *_: None)
    ran = boltlaw("discover", tmp_path / "campaign", option, "lasso", "--jobs", 1)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith(f"{option[2:]}: found 'lasso', ")
    assert said in ran.err
    assert ran.err.count("\n") == 1
    assert not (tmp_path / "campaign-results").exists()


@pytest.mark.parametrize("text", [None, "a = [", 'format = "boltlaw-laws/2"'])
def test_a_file_of_laws_that_cannot_be_read_is_one_line(
    text: str | None, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    path = tmp_path / "laws.toml"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    ran = boltlaw("discover", tmp_path, "--laws", path, "--jobs", 1)
    assert (ran.code, ran.out) == (2, "")
    assert all(line.startswith(str(path)) for line in ran.err.splitlines())


def load(folder: Path) -> dict[str, Any]:
    text = (folder / "ranking.json").read_text(encoding="utf-8")
    assert not re.search(r"\b(NaN|Infinity|-Infinity)\b", text)
    data: dict[str, Any] = json.loads(text)
    return data


def test_the_ranking_has_the_keys_that_others_read(folder: Path) -> None:
    data = load(folder)
    assert data["format"] == "boltlaw-ranking/1"
    assert data["seed"] == 4
    assert {"campaign", "program_version", "elapsed_s"} <= set(data)
    names = [law["name"] for law in data["laws"]]
    assert {"gamma(T) baseline", "no loosening", "constant gamma, quadratic"} <= set(names)
    for rank, law in enumerate(data["laws"], 1):
        assert set(law) >= CONTRACT_LAW
        assert law["rank"] == rank
        assert set(law["errors"]) == {"training", "hold_out"}
        assert set(law["errors"]["hold_out"]) == set(errors(1.0, 1))
        for parameter in law["parameters"].values():
            assert set(parameter) == {"value", "low", "high", "unit"}
    assert data["exponent_profile"]["values"] == [3.0, 4.0, 5.0]
    assert data["exponent_profile"]["delta_bic"] == [29.5, 0.0, None]
    assert data["laws"][0]["wins_against_baseline"] == [0, 5]
    assert data["laws"][1]["p_value_against_baseline"] is None  # was not a number


def test_cases_hold_the_courses_of_the_laws_by_full_simulation(folder: Path) -> None:
    """The records were made with the paper's law: it repeats them, no loosening is off by 100 %."""
    cases = load(folder)["cases"]
    assert [case["hold_out"] for case in cases] == [False, False, True, False]
    for case in cases:
        assert case["laws"][BASELINE] == pytest.approx(case["change_n"], rel=1e-3, abs=1e-3)
        assert case["loss_error_percent"][BASELINE] < 0.1
        assert case["time_s"][0] == pytest.approx(0.0015)
        assert case["change_error_n"] == [pytest.approx(0.01)] * 5


def test_the_model_is_the_identified_one_with_the_first_law(folder: Path, made: Ranking) -> None:
    model = load_model(folder / "model.json")
    rate = model.link_laws["joint"].tension_rate
    assert rate is not None
    assert rate.equation == made.laws[0].equation
    force = nominal_impact(1600.0, RATE_HZ, 2.0)
    losses = [m.simulate({"lo": force}, RATE_HZ, 150.0).tension for m in (model, paper_model())]
    assert losses[0] == pytest.approx(losses[1], rel=1e-6)
    section = json.loads((folder / "model.json").read_text(encoding="utf-8"))["identification"]
    assert section["errors"]["hold_out"]["tension_loss_error_percent_median"] == 10.0
    assert section["errors"]["no_loosening"]["training"]["records"] == 3
    assert section["fitted_records"] == fitted_records([read_campaign(folder.with_name("campaign"))])


def test_the_page_has_noise_beside_the_errors_of_the_model_with_the_first_law(folder: Path) -> None:
    (table,) = comparison_tables(read_results(folder).results)
    assert table.columns[:3] == ("", "Training", "Hold-out")
    rows = {row[0]: row[1:3] for row in table.rows}
    assert rows["Displacement, NRMSE [%]"] == ("1.20", "1.20")
    assert rows["– noise alone would give [%]"] == ("–", "1.11")


def test_every_figure_is_there_and_nothing_else(folder: Path) -> None:
    figures = {
        "law-leader-board", "law-trajectories", "law-errors", "exponent-profile", "accuracy-complexity",
        "term-inclusion",
    }  # fmt: skip
    drawn = {f"{name}.{suffix}" for name in figures for suffix in ("svg", "pdf")}
    assert {path.name for path in folder.iterdir()} == {"ranking.json", "model.json", *drawn}


def test_the_summary_says_which_law_how_sure_and_what_is_open(folder: Path) -> None:
    text = discover.summary(folder / "ranking.json")
    for part in (
        "The paper's law ranks first; these records do not distinguish it from another one.",
        "95 % set: 3.7 to 4.2",
        "2 hits of 800 N for 1 ms at a preload of 150 N",
        "2000 candidate laws were considered",
        "dT/dt = -gamma |v|^n T",
        "note: records/a.h5: clipped",
    ):
        assert part in text, part


def test_law_that_is_often_first_is_in_the_summary_whatever_its_rank(folder: Path, tmp_path: Path) -> None:
    data = load(folder)
    first = data["laws"][0]
    shares = {1: 0.9, 12: 0.02, 13: 0.08}
    data["laws"] = [
        first | {"rank": rank, "name": f"law {rank}", "source": "hand", "chosen": share, "probability": share}
        for rank, share in ((rank, shares.get(rank, 0.0)) for rank in range(1, 14))
    ]
    path = tmp_path / "ranking.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    lines = discover.summary(path).splitlines()
    listed = [line.split() for line in lines if line.endswith(tuple(f"law {k}" for k in range(1, 14)))]
    assert [words[0] for words in listed] == [*map(str, range(1, 9)), "13"]
    assert listed[-1][3] == "0.080"
    assert "Ranks that are in ranking.json alone: 9, 10, 11, 12." in lines
    assert not any("listed below" in line for line in lines)


def test_few_loosening_records_are_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("work began")

    monkeypatch.setattr("discovery.discover", never)
    assert (
        boltlaw(
            "rig", tmp_path / "few", "--cases", 3, "--duration-s", 2.5, "--hold-out-every", 3, "--quiet"
        ).code
        == 0
    )
    before = sorted(tmp_path.rglob("*"))
    ran = boltlaw("discover", tmp_path / "few", "--jobs", 1)
    assert (ran.code, ran.out) == (2, "")
    assert re.fullmatch(r".*few: found [23] loosening records.*expected 4 or more.*\n", ran.err)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.slow
@pytest.mark.variant  # docs/tutorial.md runs both commands; test_shortlist and test_race judge the laws
def test_a_small_campaign_is_ranked_from_end_to_end(
    discovered: tuple[Path, Ran], rig_campaign: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    folder, ran = discovered
    assert ran.code == 0, ran.err
    assert "rank" in ran.out
    data = load(folder)
    assert data["considered"] >= 2000
    names = {law["name"] for law in data["laws"]}
    assert {"gamma(T) baseline", "no loosening", "constant gamma, quadratic"} <= names
    assert boltlaw("predict", folder / "model.json", rig_campaign, "--out", tmp_path, "--quiet").code == 0
