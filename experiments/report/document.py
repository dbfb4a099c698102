"""One self-contained page from the result files of a folder: answer, errors, model, figures, provenance."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from discovery.criteria.criteria import used_in
from discovery.views.closure_summary import place_words
from experiments.figures.captions import caption, order
from experiments.report.comparisons import comparison_tables, identification_of
from experiments.report.interactive import (
    Mark,
    description_of,
    legend_of,
    library,
    plots_of,
    within_room,
    without_description,
)
from experiments.report.results import OF_CONTENT, Result, Results, read_results, without_odd_content
from experiments.text import closures, equations, rankings, suspicions, verdicts
from experiments.text.experiments import tables_of_cells
from experiments.text.tables import Table, parameters_table, tables_of
from experiments.text.wording import label, mapping, mappings, number
from rom.provenance import program_version

Data = Mapping[str, Any]

_LARGEST = 5e6  # bytes of a page
_REST = 2e6  # of these for text, Bokeh's script and its plots without numbers
_LONGEST_NUMBER, _LONGEST_WORD = 40, 12  # characters
_HEADER = ("format", "campaign", "program_version", "seed", "elapsed_s", "command", "campaign_digest")
_NOTES = ("set_aside", "warnings")
_SHOWN = {
    "experiment": {"cells", "name"},
    "model": {"bodies", "links", "uncoupled_links", "effects", "identification", "filter", "calibration",
              "windows", "sampling"},
    "reproduction": {"rows"},
    "ranking": {"laws", "cases", "considered", "indistinguishable", "proposals", "exponent_profile",
                "motion_profile", "inclusion", "chosen_terms", "considered_laws", "scatter"},
    "closure": {"verdict", "summary", "effects", "steps", "residual", "screened", "refitted",
                "detection_limits", "bootstrap"},
    "prediction": {"model_digest", "fitted_to_this_campaign"},
}  # fmt: skip
_OF_RANKING = ("law-", "exponent-profile", "accuracy-complexity", "term-inclusion")
"""How the names of a ranking's figures begin."""
_PLACES = (("stiffness", "k"), ("damping", "c"), ("tension_rate", "T"))


@dataclass(frozen=True)
class Picture:
    """A figure of the page: anchor, title, caption, and the image as a data address.

    What can be zoomed and read has a ``legend``, and ``choices`` where there are several records.
    """

    anchor: str
    title: str
    text: str
    source: str
    legend: tuple[Mark, ...] = ()
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Law:
    """A law or an effect of the model: its name and its equations."""

    name: str
    shown: tuple[Markup, ...]


def render(directory: Path) -> str:
    """Return the page for the result files of a folder.

    Raises
    ------
    ResultError
        If the folder holds no result file.
    """
    found = read_results(directory)
    try:
        return _page(found)
    except OF_CONTENT:
        return _page(without_odd_content(found, _page, directory))


def _page(found: Results) -> str:
    judged = _judged(found.results)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("experiments.report", "."),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    pictures, described, plots = _pictures(found)
    drawing = _drawing(environment, described, plots)
    environment.tests["short"] = _short
    environment.filters["tied"] = _tied
    return environment.get_template("page.html.j2").render(
        title=_title(found.results),
        answers=[a for result in judged if (a := verdicts.answer(result.kind, result.data))],
        cells=[t for r in found.results if r.kind == "experiment" for t in tables_of_cells(r.data)],
        closure=[b for r in found.results if r.kind == "closure" for b in closures.blocks(r.data)],
        ranking=[t for r in found.results if r.kind == "ranking" for t in rankings.tables(r.data)],
        errors=comparison_tables(judged),
        motion=_motion(found.results),
        laws=_laws(found.results),
        parameters=_present(
            parameters_table(r.data, "model")
            if r in judged
            else parameters_table(r.data, "refined model", _refitted(found.results))
            for r in found.results
            if r.kind == "model"
        ),
        pictures=pictures,
        drawing=drawing,
        allowed=" ".join(["'none'"] if drawing is None else map(_digest, drawing.programs)),
        notes=_notes(found),
        details=_details(found.results, judged),
        made=_made(found.results),
        version=program_version(),
    )


def _judged(results: Sequence[Result]) -> list[Result]:
    """Return the results but for a model that a closure in the same folder has judged already."""
    closures_made = {result.data.get("command") for result in results if result.kind == "closure"}
    return [
        result
        for result in results
        if result.kind != "model"
        or identification_of(result.data).get("command") not in closures_made - {None}
    ]


def _refitted(results: Sequence[Result]) -> list[Data]:
    return [row for r in results if r.kind == "closure" for row in mappings(r.data.get("refitted"))]


def _title(results: Sequence[Result]) -> str:
    told = [r.data.get("name" if r.kind == "experiment" else "campaign") for r in results]
    names = dict.fromkeys(str(name) for name in told if name)
    return ", ".join(names) or "Results"


def _present(tables: Any) -> list[Table]:
    return [table for table in tables if table is not None]


def _motion(results: Sequence[Result]) -> list[Markup]:
    for result in results:
        if result.kind == "model":
            bodies = [str(body.get("name")) for body in mappings(result.data.get("bodies"))]
            links = [link for link in mappings(result.data.get("links")) if "name" in link]
            return equations.equations_of_motion(bodies, links)
    return []


def _laws(results: Sequence[Result]) -> list[Law]:
    """Return the laws that are more than a constant, and the effects, of the first model."""
    model: Data = next((result.data for result in results if result.kind == "model"), {})
    laws = []
    for link in mappings(model.get("links")):
        for place, letter in _PLACES:
            law = link.get(place)
            if isinstance(law, Mapping) and str(law.get("name")) not in (
                "constant stiffness",
                "constant damping",
            ):
                laws.append(
                    Law(f"{link.get('name')}: {law.get('name')}", (_law_equation(letter, law, link),))
                )
    for effect in mappings(model.get("effects")):
        enters = str(effect.get("enters") or "")
        shown = equations.effect_equations(str(effect.get("equation") or ""), enters)
        laws.append(Law(f"{effect.get('name')}, {place_words(enters)}", tuple(shown)))
    return laws


def _law_equation(letter: str, law: Data, link: Data) -> Markup:
    if letter == "T":
        return equations.equation(equations.symbol("T", 1), str(law.get("equation")))
    left = equations.symbol(f"{letter}_{link.get('name')}") + equations.of_tension()
    return equations.equation(left, str(law.get("equation")))


def _pictures(found: Results) -> tuple[list[Picture], dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """Return the figures in order, and by anchor what those show that can be zoomed, and their plots."""
    paths = sorted(found.figures, key=lambda path: order(path.stem))
    images = {path: path.read_bytes() for path in paths}
    shown = {_anchor(path): known for path, svg in images.items() if (known := description_of(svg))}
    coded = sum(4 / 3 * len(without_description(svg)) for svg in images.values())
    plots = plots_of(shown)
    described = within_room({name: shown[name] for name in plots}, _LARGEST - _REST - coded)
    pictures = [
        _picture(path, found.results, svg, described.get(_anchor(path))) for path, svg in images.items()
    ]
    return pictures, described, {name: plots[name] for name in described}


def _anchor(path: Path) -> str:
    return "".join(c if c.isalnum() else "-" for c in path.stem)


def _picture(path: Path, results: Sequence[Result], svg: bytes, shown: Data | None) -> Picture:
    kind = "closure" if path.stem.startswith("closure-") else "ranking"
    own = next((result.data for result in results if result.kind == kind), {})
    title, text = caption(path.stem, used_in(own))
    coded = base64.b64encode(without_description(svg)).decode("ascii")
    choices = tuple(shown["choices"]) if shown and len(shown["choices"]) > 1 else ()
    legend = legend_of(shown) if shown else ()
    return Picture(_anchor(path), title, text, f"data:image/svg+xml;base64,{coded}", legend, choices)


@dataclass(frozen=True)
class Drawing:
    """What draws figures that can be zoomed: programs, and Bokeh's plots and their numbers as JSON."""

    programs: tuple[Markup, ...]
    plots: Markup
    numbers: Markup


def _drawing(
    environment: jinja2.Environment, described: Mapping[str, Data], plots: Mapping[str, Data]
) -> Drawing | None:
    if not described:
        return None
    own = environment.get_template("page.js.j2").render()
    return Drawing((Markup(library()), Markup(own)), _json(plots), _json(described))


def _json(value: object) -> Markup:
    """Return JSON that no content can end the script element of."""
    return Markup(json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))


def _digest(program: str) -> str:
    """Return what the page's security policy calls a program: no other may run."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(program.encode()).digest()).decode('ascii')}'"


def _notes(found: Results) -> list[tuple[str, list[str]]]:
    """Return what a reader must know of the data: files not read, records set aside, warnings."""
    groups = {"Files that could not be read": list(found.faults), "Two models": _of_two_models(found)}
    refined = _is_refined(found.results)
    for result in found.results:
        for key, title in (("set_aside", "Records set aside"), ("warnings", "Warnings")):
            for data in (identification_of(result.data), result.data):
                lines = data.get(key)
                if isinstance(lines, list):
                    of_file = f"{result.file}: " if refined and key == "warnings" and _is_rest(result) else ""
                    groups[title] = groups.get(title, []) + [f"{of_file}{line}" for line in lines]
        groups["Suspicions"] = groups.get("Suspicions", []) + suspicions.lines(result.data)
    return [(title, list(dict.fromkeys(lines))) for title, lines in groups.items() if lines]


def _of_two_models(found: Results) -> list[str]:
    """Say which numbers and figures are those of another model than model.json."""
    lines = [
        f"{result.file}: of another model than model.json here."
        for result in found.results
        if result.kind == "prediction" and _is_of_another_model(result, found.results)
    ]
    refined = _is_refined(found.results)
    others = [r.file for r in found.results if refined and _is_rest(r)]
    own = ("closure-",) if refined else _OF_RANKING
    if (refined or _is_of_ranking(found.results)) and any(not p.stem.startswith(own) for p in found.figures):
        others.append("figures of other commands")
    of, here = (
        ("of the model without what the closed loop added", "of the refined one")
        if refined
        else ("of the identified model", "with the law that ranks first")
    )
    told = f"{of}; model.json, the equations and the parameters are those {here}."
    return [*([f"{' and '.join(others)}: {told}"] if others else []), *lines]


def _is_refined(results: Sequence[Result]) -> bool:
    return any(r.kind == "closure" and r.data.get("effects") for r in results)


def _is_rest(result: Result) -> bool:
    """Return whether a result is one of models without what a closed loop adds."""
    return result.kind in ("ranking", "experiment")


def _is_of_another_model(prediction: Result, results: Sequence[Result]) -> bool:
    digests = [result.digest for result in results if result.kind == "model"]
    return bool(digests) and prediction.data.get("model_digest") not in [None, *digests]


def _is_of_ranking(results: Sequence[Result]) -> bool:
    """Whether the model is that with the first law of a ranking beside it."""
    commands = {r.data.get("command") for r in results if r.kind == "ranking"} - {None}
    return any(r.kind == "model" and identification_of(r.data).get("command") in commands for r in results)


def _details(results: Sequence[Result], judged: Sequence[Result]) -> list[Table]:
    """Return everything else that the files hold, as tables; the refined model's numbers stand above."""
    tables: list[Table] = []
    shown = len(judged) < len(results)
    for result in results:
        known = {*_HEADER, *_NOTES, "errors", "noise_floor", "sets", "suspicions", "unfit", "versions"}
        if result.kind == "model":
            for key, value in identification_of(result.data).items():
                if key not in {*_HEADER, *_NOTES, "errors", "noise_floor", "records", "fitted_records"}:
                    tables += tables_of(value, label(key))
        known |= _SHOWN.get(result.kind, set())
        tables += closures.details(result.data, shown) if result.kind == "closure" else []
        for key, value in result.data.items():
            if key not in known:
                tables += tables_of(value, f"{label(result.kind)}: {label(key).lower()}")
    return [*tables, *_versions(results)]


def _versions(results: Sequence[Result]) -> Iterator[Table]:
    """Yield the versions of packages, once for all files that share them."""
    files: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for result in results:
        shown = tuple((str(name), str(one)) for name, one in mapping(result.data.get("versions")).items())
        if shown:
            files.setdefault(shown, []).append(result.file)
    for shown, names in files.items():
        of = f" of {', '.join(names)}" if len(files) > 1 else ""
        yield Table(f"Versions{of}", (), shown)


def _made(results: Sequence[Result]) -> Table:
    rows = []
    for result in results:
        head = {**{key: identification_of(result.data).get(key) for key in _HEADER}, **_given(result.data)}
        rows.append(
            (result.file, _text(head.get("command")), _text(head.get("campaign")),
             _text(head.get("campaign_digest")), _text(head.get("seed")), number(head.get("elapsed_s"), 3),
             _text(head.get("program_version")), result.digest)
        )  # fmt: skip
    heads = (
        "File",
        "Command",
        "Campaign",
        "SHA-256 of the campaign",
        "Seed",
        "Time [s]",
        "Version",
        "SHA-256 of the file",
    )
    columns = list(zip(*rows, strict=True))
    kept = [place for place, column in enumerate(columns) if any(cell != "–" for cell in column)]
    body = tuple(zip(*(columns[place] for place in kept), strict=True))
    return Table("How it was made", tuple(heads[place] for place in kept), body)


def _given(data: Data) -> Data:
    return {key: data[key] for key in _HEADER if data.get(key) is not None}


def _text(value: object) -> str:
    return "–" if value is None else str(value)


def _tied(text: str) -> str:
    """Return text whose per cent signs stay on the line of their number."""
    return text.replace(" %", "\u00a0%")


def _short(cell: object) -> bool:
    """Return whether a cell stays on one line: numbers with their limits, units, a symbol, a word."""
    if isinstance(cell, Markup):
        return len(cell.striptags()) < _LONGEST_WORD
    if not isinstance(cell, str):
        return False
    return len(cell) < (_LONGEST_NUMBER if cell[:1] in "−–0123456789" else _LONGEST_WORD)
