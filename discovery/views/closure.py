"""A closed loop in plain words: what was missing, how one knows, what changed, what remains; and a figure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from discovery.localisation.localise import COURSES
from discovery.loop.result import Closure, FoundEffect
from discovery.views.force import (
    FORCE,
    Data,
    draw_loop,
    draw_map,
    explained_level,
    pair,
    scale_of,
    units_of,
)
from rom import viewed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from pandas import DataFrame

    from discovery.localisation.localise import Localisation
    from rom.evaluation.error_measures import Kind
    from rom.model.laws import Parameter

_VIEWS = {  # others are said as they are named
    "by_test": "kind of test",
    "by_time": "time since the impact",
    "by_harmonic": "harmonic of the dominant frequency",
    "by_place": "place of a missing force",
    "by_sign": "sign of the displacement",
    "tension_by_preload": "preload, of the tension's courses",
    "tension_by_velocity": "relative velocity, of the tension's courses",
    "tension_by_time": "time since the impact, of the tension's courses",
}
_PLACED = {  # what is said before a label where it stands out
    "by_time": "after the impact",
    "by_harmonic": "",
    "by_place": "as a force,",
    "by_sign": "displacement",
    "tension_by_preload": "courses of the tension at",
    "tension_by_velocity": "courses of the tension at",
    "tension_by_time": "courses of the tension after",
}
_MEASURES = (
    ("motion_nrmse", "the displacement", 100.0, " %"),
    ("relative_motion_nrmse", "the relative displacement of the joint", 100.0, " %"),
    ("tension_loss_error_percent_median", "the loss of tension (median)", 1.0, " %"),
    ("tension_rmse_n", "the tension after the impact", 1.0, " N"),
    ("link_force_nrmse", "the link force", 100.0, " %"),
)
_CHANCES = {
    "drawn": "the chance that the best of the whole catalogue does as well where nothing is missing",
    "likelihood ratio": "the chance of that were noise alone left, independent from row to row, times the "
    "number of effects tried",
}
_STANDS_OUT = 1.3  # times the smallest of its view
_NAMED = 3
_SURE = 0.01
_SAME = 0.02
_TELLS = 0.1  # of the force's variance: a map that explains less is not worth words


@viewed.summary.register(Closure)
def paragraph(closure: Closure) -> str:
    """Return the result for people: what was missing, how one knows, what changed, what remains."""
    return "\n".join(sections(closure).values())


def sections(closure: Closure) -> Mapping[str, str]:
    """Return what was ``missing``, its ``numbers``, the ``evidence``, what ``changed`` and what ``remains``.

    Of several effects each has a line in its section; one about which there is nothing to say is left out.
    """
    parts = {
        "missing": ("What was missing: ", _missing),
        "numbers": ("", _numbers),
        "evidence": ("How one knows: ", _evidence),
        "changed": ("What changed: ", _changed),
        "remains": ("What remains: ", _remains),
    }
    said = {key: (head, "\n".join(say(closure))) for key, (head, say) in parts.items()}
    return {key: head + text for key, (head, text) in said.items() if text}


def place_words(enters: str) -> str:
    """Return where an effect enters, in words: ``"the link joint"``, ``"the body so"``."""
    kind, _, name = enters.partition(":")
    if kind == "tension":
        return "the tension of the bolt"
    return f"the {kind} {name}" if name else f"the link {enters}"


def _missing(closure: Closure) -> Iterator[str]:
    if closure.effects:
        faults = any(found.effect.place == "sensor" for found in closure.effects)
        more = " A sensor's fault is taken out of the records; it is no force." if faults else ""
        yield f"{' and '.join(map(_named, closure.effects))}.{more}"
    elif closure.verdict == "unexplained":
        yield "something that no effect of the catalogue explains."
    else:
        yield "nothing that these records show; no effect of the catalogue beats chance."


def _numbers(closure: Closure) -> Iterator[str]:
    from rom.signals.per_record_parameters import per_record_names

    for found in closure.effects:
        effect = found.effect
        own = per_record_names(effect)
        numbers = [_with_limits(name, p, name in own) for name, p in effect.parameters.items()]
        yield f"{effect.name}: {effect.equation}{', with ' if numbers else ''}{', '.join(numbers)}."


def _named(found: FoundEffect) -> str:
    what = "a term outside the catalogue" if found.source == "free-form" else found.effect.name
    return f"{what} in {place_words(found.effect.enters)}"


def _with_limits(name: str, parameter: Parameter, of_records: bool) -> str:
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    shown = f"{name} = {_number(parameter.value)}{unit}"
    if parameter.low is None or parameter.high is None:
        return shown
    of = "95 % of records" if of_records else "95 %"
    return f"{shown} ({of}: {_number(parameter.low)} to {_number(parameter.high)})"


def _evidence(closure: Closure) -> Iterator[str]:
    several = len(closure.effects) > 1
    for found in closure.effects:
        won, records = found.wins
        what = found.effect.name if several else "it"
        text = f"{what} takes away {_percent(found.share)} of {found.basis} on training records"
        if records:
            text += f", and {won} of {records} held-out records are met better with it"
        if _known(found.p_value):
            text += f"; {_CHANCES[found.chance]}: p {_chance(found.p_value)}"
        yield " ".join([f"{text}.", *_on_look_alikes(found)])
    yield from _on_the_rest(closure)


def _on_look_alikes(found: FoundEffect) -> Iterator[str]:
    alike = found.look_alikes
    if not alike:
        return
    named = [f"{like.name} in {place_words(like.enters)}" for like in alike[:_NAMED]]
    more = f" and {len(alike) - _NAMED} more" if len(alike) > _NAMED else ""
    yield f"These records do not tell {found.effect.name} for sure from {', '.join(named)}{more}."
    tests = dict.fromkeys(like.test.rstrip(".") for like in alike if like.test)
    if tests:
        yield f"What would separate them: {'; '.join(list(tests)[:_NAMED])}."


def _on_the_rest(closure: Closure) -> Iterator[str]:
    """Say what the best candidate was that is neither an effect found nor a look-alike of one."""
    said = {(found.effect.name, found.effect.enters) for found in closure.effects}
    said |= {(like.name, like.enters) for found in closure.effects for like in found.look_alikes}
    rest = [item for item in closure.screened if (item.name, item.enters) not in said]
    if rest:
        best = max(rest, key=lambda item: item.share)
        which = "Of the other candidates" if closure.effects else "of all candidates"
        yield (
            f"{which} {best.name} in {place_words(best.enters)} alone could explain most, "
            f"{_percent(best.share)} of the residual of the declared model."
        )


def _changed(closure: Closure) -> Iterator[str]:
    if not closure.effects:
        return
    unseen = bool(closure.after["hold_out"]["records"])
    where = "records that no fit has seen" if unseen else "training records (none was held out)"
    kind: Kind = "hold_out" if unseen else "training"
    before, after = closure.before[kind], closure.after[kind]
    balance = [
        dict(one.numbers).get(f"force_error_{kind}")
        for one in (closure.residual_before, closure.residual_after)
    ]
    changes = [
        f"the balance of forces from {_number(100 * old, 3)} to {_number(100 * new, 3)} %"
        for old, new in [balance]
        if old is not None and new is not None
    ] + [
        f"{words} from {_number(factor * float(str(old)), 3)} to {_number(factor * float(str(new)), 3)}{unit}"
        for key, words, factor, unit in _MEASURES
        if _known(old := before.get(key)) and _known(new := after.get(key))
    ]
    if changes:
        yield f"on {where} the errors go: {'; '.join(changes)}."


def _remains(closure: Closure) -> Iterator[str]:
    before, after = closure.residual_before, closure.residual_after
    start = f"was {_number(before.total)} and " if closure.effects else ""
    size = f"the mean square of the residual {start}is {_number(after.total)} times that of noise."
    rest = [*(_left(after) if closure.verdict == "unexplained" else _like_noise(after))]
    yield " ".join([size, *rest, *_on_courses(before, after)])


def _on_courses(before: Localisation, after: Localisation) -> Iterator[str]:
    old, new = (dict(one.numbers).get(COURSES) for one in (before, after))
    if old is not None and new is not None:
        was = f"{_number(old, 3)} before and " if abs(old - new) > _SAME * new else ""
        yield (
            f"Courses of the tension after the hits: mean square {was}{_number(new, 3)} times that of noise, "
            "each test's own rate allowed for."
        )


def _like_noise(after: Localisation) -> Iterator[str]:
    if not _known(after.whiteness_p):
        return
    if after.whiteness_p >= _SURE:
        yield f"What is left shows no more dependence than noise would (p = {_number(after.whiteness_p, 2)})."
    else:
        p = _chance(after.whiteness_p)
        yield f"What is left is small, but shows more dependence than noise would (p {p})."


def _left(after: Localisation) -> Iterator[str]:
    places = list(lives_in(after))
    where = f"It is largest at: {'; '.join(places)}" if places else "It stands out in no view"
    yield f"What is left is more than noise. {where}."
    yield from _as_force(after)
    repeats = dict(after.repeats)
    if repeats:
        alike, chance = (_number(repeats[key], 2) for key in ("repeatability", "repeatability_chance"))
        yield f"Tests that repeat each other leave residuals that correlate by {alike} (noise: {chance})."


def _as_force(after: Localisation) -> Iterator[str]:
    """Say how much of the force that is left is a function of the motion, where it is most."""
    one = max(after.forces, key=lambda force: explained_level(force.as_dict()), default=None)
    if one is None or one.explained_p > _SURE or one.explained < _TELLS:
        return
    kind = "even" if one.elastic >= 0.5 else "odd"
    share = _percent(one.elastic if one.elastic >= 0.5 else 1 - one.elastic)
    yield (
        f"As a force on {_place(one.place)} {_percent(one.explained)} of it is one function of displacement "
        f"and velocity, {kind} in velocity by {share}; {_percent(one.rest)} is memory, or differs from "
        "record to record."
    )


def _place(name: str) -> str:
    return f"the {name}" if name.startswith("body ") else f"the link {name}"


def _views(residual: Localisation) -> Mapping[str, Mapping[str, float]]:
    """Mean squares by label, by view."""
    return {
        view: profile
        for view, profile in residual.as_dict().items()
        if isinstance(profile, Mapping) and profile
    }


def _view_words(view: str) -> str:
    return _VIEWS.get(view, view.removeprefix("by_").replace("_", " "))


def lives_in(residual: Localisation) -> Iterator[str]:
    """Yield where a residual stands out, a phrase for each view in which it does."""
    for view, profile in _views(residual).items():
        known = {label: value for label, value in profile.items() if _known(value)}
        if len(known) < 2:
            continue
        label = max(known, key=lambda name: known[name])
        if known[label] > 1.0 and known[label] > _STANDS_OUT * min(known.values()):
            words = f"{_PLACED.get(view, _view_words(view))} {label}".strip()
            yield f"{words} ({_number(known[label])} times noise)"


def _known(value: object) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _number(value: float, digits: int = 4) -> str:
    """Return a number of some digits, without a power of ten where it can be helped."""
    short = float(f"{value:.{digits}g}")
    return f"{short:.10g}" if 1e-4 < abs(short) < 1e6 else f"{short:.{digits}g}"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %" if share >= 1e-3 else "less than 0.1 %"


def _chance(p: float) -> str:
    return f"= {_number(p, 2)}" if p >= 1e-4 else "below 0.0001"


@viewed.frame.register(Closure)
def frame(closure: Closure) -> DataFrame:
    """Return errors before and after every step, a row each."""
    from pandas import DataFrame

    rows = [
        {"model": step.added or "declared", "set": kind, **errors}
        for step in closure.steps
        for kind, errors in step.errors.items()
    ]
    return DataFrame(rows)


@viewed.figure.register(Closure)
def figure(closure: Closure) -> Figure:
    """Draw the mean square of the residual along every view, before and after, over that of noise.

    Below, where there are such, the force left unbalanced at the place where most was left: maps over
    displacement and velocity with one scale, and loops in the first cycles.
    """
    from matplotlib.figure import Figure

    before, after = closure.residual_before, closure.residual_after
    rows = max(-(-len(_views(before)) // 2), 1)
    forces = pair(*([one.as_dict() for one in side.forces] for side in (before, after)))
    heights = (2.6 * rows, 3.4)
    made = Figure(figsize=(10, sum(heights) if forces else heights[0]), layout="constrained")
    if forces is None:
        _draw_views(made, rows, before, after)
    else:
        upper, lower = made.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
        _draw_views(upper, rows, before, after)
        _draw_forces(lower, *forces)
    return made


def _draw_views(made: Figure | SubFigure, rows: int, before: Localisation, after: Localisation) -> None:
    old, new = _views(before), _views(after)
    axes = made.subplots(rows, 2, squeeze=False)
    for ax, (view, profile) in zip(axes.flat, old.items(), strict=False):
        _draw_view(ax, profile, new.get(view, {}))
        ax.set_title(f"by {_view_words(view)}", loc="left", fontsize="medium")
    for ax in axes.flat[len(old) :]:
        ax.remove()
    if old:
        axes[0, 0].legend(frameon=False)
    made.supxlabel("mean square of the residual over that of noise [1]", fontsize="medium")


def _draw_forces(made: Figure | SubFigure, before: Data, after: Data) -> None:
    axes = made.subplots(1, 3, squeeze=False)[0]
    limit, units = scale_of(before, after), units_of(before, after)
    for ax, one, when in zip(axes, (before, after), ("before", "after"), strict=False):
        mesh = draw_map(ax, one, limit, units)
        ax.set_title(f"force left at {one['place']}, {when}", loc="left", fontsize="medium")
        ax.set_xlabel(units.displacement)
    axes[0].set_ylabel(units.velocity)
    made.colorbar(mesh, ax=axes[:2]).ax.set_title("[N]", fontsize="medium")
    for one, colour, when in ((before, "C1", "before"), (after, "C0", "after")):
        draw_loop(axes[2], one, colour, when, units)
    axes[2].set_title("first cycles of the largest motion", loc="left", fontsize="medium")
    axes[2].set(xlabel=units.displacement, ylabel=FORCE)


def _draw_view(ax: Axes, before: Mapping[str, float], after: Mapping[str, float]) -> None:
    labels = list(before)
    for name, profile, colour in (("before", before, "C1"), ("after", after, "C0")):
        values = [profile.get(label, math.nan) for label in labels]
        ax.plot(values, range(len(labels)), "o", color=colour, label=name)
    ax.axvline(1.0, color="0.6", linestyle="--", linewidth=1)
    ax.set_yticks(range(len(labels)), labels)
    ax.set_ylim(len(labels) - 0.5, -0.5)
    ax.set_xscale("log")
