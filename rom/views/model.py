"""Views of a model and of the identification that found it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rom import result_views
from rom.campaign.channels import FloatArray
from rom.identification.identify import Identification
from rom.identification.modal_model import IdentifiedMode
from rom.model.laws import Law, Parameter
from rom.model.model import Model
from rom.model.shapes import ModeShapes, shape_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

_SPEED = 0.1  # at which a tension law is drawn [m/s]
_TENSIONS = (1.0, 3000.0)  # over which laws are drawn that no record belongs to [N]


@result_views.summary.register(Model)
def _model_summary(model: Model) -> str:
    """Return bodies, laws with their numbers and 95 % limits, effects, and how the model was found."""
    masses = ", ".join(f"{body.name} {body.mass:.5g} kg" for body in model.structure.bodies)
    lines = [f"bodies: {masses}"]
    if model.shapes is not None:
        lines += _shape_lines(model.shapes)
    for link in model.structure.links:
        lines.append(f"{link.name}: {link.law}, between {link.first} and {link.second}")
        laws = model.link_laws[link.name]
        for letter, law in (("k", laws.stiffness), ("c", laws.damping), ("dT/dt", laws.tension_rate)):
            lines += _law_lines(letter, law) if law is not None else []
    for effect in model.effects:
        lines.append(f"{effect.name} in {effect.enters}: {effect.equation}")
        lines += [f"    {name} = {with_limits(p)}" for name, p in effect.parameters.items()]
    found = _identification(model)
    return "\n".join([*lines, *(() if found is None else _identification_lines(found))])


def _shape_lines(shapes: ModeShapes) -> Iterator[str]:
    for mode in shapes.modes:
        numbers = {place: shapes.numbers[shape_path(mode, place)] for place in shapes.sensors}
        yield f"{mode} shows " + ", ".join(f"{with_limits(p, 4)} at {place}" for place, p in numbers.items())


def _mode_line(mode: IdentifiedMode) -> str:
    frequency, ratio = with_limits(mode.frequency_hz, 6), with_limits(mode.damping_ratio, 4)
    return f"{mode.name}: natural frequency {frequency}, damping ratio {ratio}"


def _law_lines(letter: str, law: Law) -> Iterator[str]:
    yield f"  {letter} = {law.equation}"
    yield from (f"    {name} = {with_limits(p)}" for name, p in law.parameters.items())


def with_limits(parameter: Parameter, digits: int = 5, level: str = "95 %") -> str:
    """Return ``"4.02 N (95 %: 3.96 to 4.09)"``; a number at a bound has one limit alone.

    Parameters
    ----------
    parameter : Parameter
        The number.
    digits : int
        That are shown.
    level : str
        Of its limits, in words.
    """
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    low, high = (None if end is None else f"{end:.{digits}g}" for end in parameter.limits)
    words = f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"
    return f"{parameter.value:.{digits}g}{unit}" + (f" ({level}: {words})" if low or high else "")


def _identification(model: Model) -> Identification | None:
    return model.identification if isinstance(model.identification, Identification) else None


def _identification_lines(found: Identification) -> Iterator[str]:
    yield from map(_mode_line, found.modes)
    aside = len({doubt.file for doubt in found.set_aside})
    yield f"identified from {len(found.records)} training records, {aside} set aside"
    yield from (f"  note: {text}" for text in found.warnings)
    yield from (f"  set aside: {doubt.file}: {doubt.message}" for doubt in found.set_aside)


@result_views.frame.register(Model)
def _model_frame(model: Model) -> DataFrame:
    """Return a row for each parameter, by path."""
    from pandas import DataFrame

    rows = {
        path: {"value": p.value, "low": p.low, "high": p.high, "unit": p.unit, "source": p.source}
        for path, p in model.parameters.items()
    }
    return DataFrame.from_dict(rows, orient="index").rename_axis("parameter")


@result_views.figure.register(Model)
def _model_figure(model: Model) -> Figure:
    """Draw stiffness, damping and loss rate of every bolted link over tension, with what was identified.

    Raises
    ------
    ValueError
        If no link is bolted.
    """
    from matplotlib.figure import Figure

    bolted = model.structure.bolted_links
    if not bolted:
        raise ValueError("found no bolted link, expected one: only its laws change with the tension")
    points = _points(model) if len(bolted) == 1 else {}
    seen = [float(t) for tensions, _ in points.values() for t in tensions if t > 0]
    tension = np.geomspace(*((min(seen), max(seen)) if len(set(seen)) > 1 else _TENSIONS), 200)
    figure = Figure(figsize=(10, 3 * len(bolted)), layout="constrained")
    for row, link in zip(figure.subplots(len(bolted), 3, squeeze=False), bolted, strict=True):
        for axes, (label, values) in zip(row, _curves(model, link, tension).items(), strict=True):
            _draw(axes, tension, values, points.get(label))
            axes.set_ylabel(label)
        row[0].set_title(link, loc="left", fontsize="medium")
    figure.supxlabel("tension [N]", fontsize="medium")
    return figure


_LABELS = ("stiffness [N/m]", "damping [N s/m]", f"loss of tension at {_SPEED:g} m/s [N/s]")


def _curves(model: Model, link: str, tension: FloatArray) -> Mapping[str, FloatArray]:
    laws = model.acting_laws[link]
    assert laws.tension_rate is not None
    loss = -laws.tension_rate.rate(tension, 0.0, _SPEED)
    return dict(zip(_LABELS, (laws.stiffness(tension), laws.damping(tension), loss), strict=True))


def _points(model: Model) -> Mapping[str, tuple[FloatArray, FloatArray]]:
    """What each record told: tensions and values, by the label of its axis."""
    found = _identification(model)
    if found is None:
        return {}
    tension = np.array([estimate.tension for estimate in found.joint])
    initial = np.array([estimate.initial for estimate in found.gamma])
    values = (
        [estimate.stiffness for estimate in found.joint],
        [estimate.damping for estimate in found.joint],
        [estimate.gamma * _SPEED**4 * estimate.initial for estimate in found.gamma],
    )
    places = (tension, tension, initial)
    return {k: (t, np.array(v)) for k, t, v in zip(_LABELS, places, values, strict=True) if len(t)}


def _draw(
    axes: Axes, tension: FloatArray, values: FloatArray, points: tuple[FloatArray, FloatArray] | None
) -> None:
    axes.plot(tension, values, "C0")
    if points is not None:
        axes.plot(*points, "C1.")
    axes.set_xscale("log")


@result_views.summary.register(Identification)
def _identification_summary(found: Identification) -> str:
    """Return the model found, and what to know of how it was."""
    return _model_summary(replace(found.model, identification=found))


@result_views.frame.register(Identification)
def _identification_frame(found: Identification) -> DataFrame:
    """Return what each training record told of the joint, a row each by file."""
    from pandas import DataFrame

    rows: dict[str, dict[str, float | None]] = {file: {} for file in found.records}
    for joint in found.joint:
        rows.setdefault(joint.file, {}).update(
            tension_n=joint.tension, stiffness_n_per_m=joint.stiffness, damping_ns_per_m=joint.damping
        )
    for case in found.gamma:
        rows.setdefault(case.file, {}).update(
            tension_n=case.initial, final_tension_n=case.final, gamma_s3_per_m4=case.gamma
        )
    columns = ("tension_n", "stiffness_n_per_m", "damping_ns_per_m", "final_tension_n", "gamma_s3_per_m4")
    frame = DataFrame.from_dict(rows, orient="index").rename_axis("file")
    return frame.reindex(columns=list(columns))


@result_views.figure.register(Identification)
def _identification_figure(found: Identification) -> Figure:
    """Draw stiffness, damping and loss rate over tension, with the estimates of each record."""
    return _model_figure(replace(found.model, identification=found))
