"""The page on measured data of others: per set, what the declared model lacked and how that is known.

Every number comes from a reference file, which holds what `boltlaw close` wrote for that set.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from discovery.views.closure_summary import place_words, sections
from experiments.text import closures
from experiments.text.closures import effects_of
from experiments.text.tables import MEASURES, Table, error_rows
from experiments.text.wording import NONE, number, with_limits

Data = Mapping[str, Any]
Place = tuple[str, str]  # where a parameter stands in model.json, and its name

_COLUMNS = (
    ("training", "before"), ("training", "after"), ("hold_out", "before"), ("hold_out", "after"),
)  # fmt: skip


_VIEWS = {
    "force_error": ("Balance of forces, RMS of what is left over RMS of the force", "%", 100.0),
    "simulation_rms_m": ("Simulated less measured displacement, RMS", "10⁻³ m, or mV", 1e3),
}
_SCREENED = 12
_QUESTIONS = (
    "What was missing",
    "What helped",
    "How one knows",
    "Of the other candidates",
    "What changed",
    "What remains",
)


@dataclass(frozen=True)
class MeasuredSet:
    """A public set: what it is, who measured it, and what they found, by place and name of the parameter."""

    title: str
    what: str
    source: str
    published: Mapping[Place, float]
    published_by: str = ""


SETS: Mapping[str, MeasuredSet] = {
    "emps": MeasuredSet(
        "EMPS: a carriage on a guide",
        "A motor drives a carriage through a ball screw, under position control. The force is the drive's "
        "voltage times its gain. Held out: the same motion with pulses of force.",
        "A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, Workshop on Nonlinear "
        "System Identification Benchmarks, 2019",
        {
            ("carriage", "mass"): 95.1089,
            ("guide: damping", "c"): 203.5034,
            ("coulomb-friction, link guide", "F_c"): 20.3935,
            ("constant-force, body carriage", "F_0"): 3.1648,
        },
        "the reference model that comes with the data, whose offset of −3.1648 N stands on the other side",
    ),
    "silverbox": MeasuredSet(
        "Silverbox: a circuit that imitates a mass on a hardening spring",
        "Ten multisines and an arrow of growing noise, which goes beyond them. Volts are taken as N and m, "
        "so only ratios to the mass mean anything. Held out: the last multisine and the arrow.",
        "T. Wigren, J. Schoukens, Three free data sets for development and benchmarking in nonlinear system "
        "identification, European Control Conference, 2013",
        {},
    ),
    "tribometer": MeasuredSet(
        "Tribometer: a reciprocating contact",
        "A slider moves by 0.24 mm to and fro under a normal force of 5 N. Held out: the last two fifths.",
        "FrictionModels.jl, examples/test_data_2.txt (J. Christopherson); the rig is not described there",
        {},
    ),
}


def page(references: Mapping[str, Data]) -> str:
    """Return the page in Markdown: a section per set, in the order of `SETS`."""
    parts = [
        "# Measured data of others",
        "Data that this project did not make, each with an effect that a simple model lacks. The simple "
        "model is declared, `boltlaw close` says what it lacks. Every number below is in `docs/measured/`; "
        "the commands of a section make it anew, and this page is written by "
        "`python -m experiments.studies.measured`.",
        "`closed` says that less than 3 % of what was beyond noise in the residual's mean square is left, "
        "**not** that the residual is at noise: these sensors are far quieter than a simple model is right. "
        "`unexplained` says that more is left, even where a named effect explains most of it.",
        overview(references),
        *(section(name, references[name]) for name in SETS if name in references),
    ]
    return "\n\n".join(parts) + "\n"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [list(header), ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def overview(references: Mapping[str, Data]) -> str:
    """Return a row per set: verdict, effects, and the errors on hold-out records before and after."""
    rows = []
    for name in SETS:
        closure = (references.get(name) or {}).get("closure")
        if not isinstance(closure, Mapping):
            rows.append([name, "no result yet", NONE, NONE, NONE])
            continue
        found = ", ".join(f"{e['name']} ({place_words(e['enters'])})" for e in effects_of(closure))
        key = _main_measure(closure)
        errors = closure["errors"]["hold_out"]
        before, after = (_percent(errors[when].get(key), key) for when in ("before", "after"))
        rows.append([name, str(closure["verdict"]), found or NONE, before, after])
    return table(("set", "verdict", "effects found", "hold-out error before", "after"), rows)


def _main_measure(closure: Data) -> str:
    """Return the first error measure that the set has: of motion, or of a link's force."""
    before = closure["errors"]["hold_out"]["before"]
    return next((key for key in MEASURES if isinstance(before.get(key), float)), "")


def _percent(value: object, key: str) -> str:
    if not isinstance(value, float):
        return NONE
    text, unit, factor = MEASURES[key]
    return f"{number(factor * value, 3)} {unit} ({text[:1].lower()}{text[1:]})"


def section(name: str, reference: Data) -> str:
    """Return what there is to tell of one set."""
    about, closure = SETS[name], reference["closure"]
    closure = {**closure, "summary": sections(closure)}  # sentences of today, numbers as they were
    told, force = closures.answer(closure), closures.force_table(closure)
    parts = [
        f"## {about.title}",
        f"{about.what} Source: {about.source}.",
        f"**Declared:** {declared(reference['model'])}.",
        f"**{told.verdict}**",
        "\n".join(_items(told.sentences)),
        f"![Where the residual lived, before and after](images/measured-{name}.svg)",
        *_force(name, force),
        table(("parameter", "value", "95 % limits", "unit", "published"), parameter_rows(about, reference)),
        _published_note(about),
        error_table(closure["errors"]),
        views_table(closure["residual"]),
        alone_table(closure.get("screened", ())),
        *_look_alikes(closure),
        *(f"Note: {text}." for text in (*closure.get("set_aside", ()), *closure.get("warnings", ()))),
        f"```sh\n{commands(name, closure)}\n```",
        f"Program version {closure['program_version']}, {number(float(closure['elapsed_s']), 3)} s.",
    ]
    return "\n\n".join(part for part in parts if part)


def _items(sentences: Sequence[str]) -> Iterator[str]:
    """Yield an item of a list for each question that is answered, the sentences after it with it."""
    item: list[str] = []
    for sentence in sentences:
        if item and sentence.startswith(_QUESTIONS):
            yield f"- {' '.join(item)}"
            item = []
        item.append(sentence)
    if item:
        yield f"- {' '.join(item)}"


def _force(name: str, told: Table) -> Iterator[str]:
    """Yield the picture of the force that was left over motion, and its numbers."""
    if told.rows:
        yield f"**{told.caption}**, as a function of motion:"
        yield f"![The force that was left, over displacement and velocity](images/measured-{name}-force.svg)"
        yield table([str(head) for head in told.columns], [[str(cell) for cell in row] for row in told.rows])


def declared(model: Data) -> str:
    """Return the declared model in words: bodies and links."""
    bodies = ", ".join(str(body["name"]) for body in model["bodies"])
    links = ", ".join(
        f"{link['name']} ({link['law']}, {' to '.join(link['between'])})" for link in model["links"]
    )
    return f"bodies: {bodies}; links: {links}"


def parameter_rows(about: MeasuredSet, reference: Data) -> Iterator[list[str]]:
    """Yield a row per parameter of the refined model, and one per published value that was not found."""
    found = dict(parameters_of(reference["model"], reference["closure"]))
    for (place, name), parameter in found.items():
        value, limits = with_limits(parameter.get("value"), parameter.get("low"), parameter.get("high"))
        unit = str(parameter.get("unit") or "")
        published = _published(about.published.get((place, name)))
        yield [f"{place}: {name}", value, limits, "" if unit == "1" else unit, published]
    for (place, name), own in about.published.items():
        if (place, name) not in found:
            yield [f"{place}: {name}", "not found", NONE, "", _published(own)]


def _published(value: float | None) -> str:
    return NONE if value is None else f"{value:g}".replace("-", "−")


def parameters_of(model: Data, closure: Data) -> Iterator[tuple[Place, Data]]:
    """Yield every parameter of a refined model: masses, links, effects; a later row has the limits."""
    for body in model["bodies"]:
        yield (str(body["name"]), "mass"), body["mass"]
    for link in model["links"]:
        for kind in ("stiffness", "damping"):
            if kind == "stiffness" and link["law"] == "dashpot":
                continue
            for name, parameter in (link.get(kind) or {}).get("parameters", {}).items():
                yield (f"{link['name']}: {kind}", name), parameter
    for effect in (*model.get("effects", ()), *effects_of(closure)):
        place = f"{effect['name']}, {place_words(effect['enters'])}"
        for name, parameter in effect["parameters"].items():
            yield (place, name), parameter


def _published_note(about: MeasuredSet) -> str:
    if about.published:
        return f"Published: {about.published_by}."
    return "Published: no values that these could be set beside."


def error_table(errors: Data) -> str:
    """Return every error measure that there is, on training and hold-out records, before and after."""
    columns = [errors[kind][when] for kind, when in _COLUMNS]
    rows = [[str(cell) for cell in row] for row in error_rows(columns)]
    heads = [f"{kind.replace('_', '-')}, {when}" for kind, when in _COLUMNS]
    return table(("error", *heads), rows)


def views_table(residual: Data) -> str:
    """Return the errors of the balance of forces and of each simulation, in the records' own units."""
    rows = []
    for key, before in residual["before"].items():
        view, _, record = key.partition(" in ")
        head = next((head for head in _VIEWS if view.startswith(head)), None)
        if head is not None:
            text, unit, factor = _VIEWS[head]
            of = record or view.removeprefix(f"{head}_").replace("_", "-")
            after = residual["after"].get(key)
            rows.append([f"{text}, {of} [{unit}]", *(_scaled(value, factor) for value in (before, after))])
    return table(("view", "before", "after"), rows) if rows else ""


def _scaled(value: object, factor: float) -> str:
    return number(factor * value, 3) if isinstance(value, float) else NONE


def alone_table(screened: Sequence[Data]) -> str:
    """Return what each effect of the first screen could explain of the residual by itself."""
    rows = [
        [one["name"], place_words(one["enters"]), number(100 * max(one["share"], 0.0), 3)]
        for one in screened[:_SCREENED]
    ]
    return table(("effect alone", "place", "explains, screened [%]"), rows) if rows else ""


def _look_alikes(closure: Data) -> Iterator[str]:
    for effect in effects_of(closure):
        alike = [
            f"{one['name']} ({place_words(one.get('enters'))}; {number(one['hold_out_cost'], 3)})"
            for one in effect.get("look_alikes", ())
        ]
        if alike:
            what = "place; hold-out cost over its own"
            yield f"Look-alikes of {effect['name']} ({what}): {', '.join(alike)}."


def commands(name: str, closure: Data) -> str:
    """Return the commands that make the reference anew."""
    fetch = "--download" if name in ("emps", "silverbox") else "SOURCE"
    return "\n".join(
        (
            f"boltlaw import {name} {fetch} {name}",
            f"boltlaw close {name} --seed {closure['seed']}",
            f"python -m experiments.studies.measured {name}={name}-results",
        )
    )
