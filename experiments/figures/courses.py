"""Records to choose from: measured and modelled course over time, and what each model leaves of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from discovery.views.palette import AFTER, BACKGROUND, BEFORE, MEASURED
from experiments.figures.description import Drawn
from experiments.figures.style import FloatArray, panels, styled
from experiments.figures.tensions import thinned
from rom.evaluation.replay import (
    Replay,
    displacements,
    driven_forces,
    replay,
    shown_tension,
    tension_known,
)
from rom.model.model import Model
from rom.progress import counted
from rom.signals.motion import time_factor
from rom.signals.processing import Measurement

_PIECES = 300  # of a trace, drawn as their extremes: half a page is about as many pixels wide
_SHOWN_S = 0.6
_LOOKS: tuple[dict[str, Any], ...] = (
    {"color": BEFORE, "linestyle": "--", "lw": 0.9},
    {"color": AFTER, "linestyle": "-.", "lw": 0.9},
)
_MICRO = 1e-4  # where all displacements are below they are told in micrometres [m]


class Course(NamedTuple):
    """A measured quantity of a record over time [s], and what models make of it; the first is measured."""

    name: str
    unit: str
    time: FloatArray
    measured: FloatArray
    modelled: Mapping[str, FloatArray]
    residual: Mapping[str, FloatArray]


def record_figures(
    measurements: Sequence[Measurement],
    models: Mapping[str, Model],
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Callable[[], Drawn]]:
    """Return what draws each record that a model can run again, one after the other into the same panels.

    Parameters
    ----------
    measurements : sequence of Measurement
        Records.
    models : mapping of str to Model
        By the name in the legend, at most two.
    progress : callable, optional
        Takes records run again and records in all.

    Returns
    -------
    dict
        By file, kind of test, tension, whether it is held out and which models do not finish; what the first
        model meets worst first.
    """
    made: dict[str, list[Course]] = {}
    for measurement in counted(measurements, len(measurements), progress):
        courses = _courses(measurement, models)
        if courses:
            made[_title(measurement, _unfinished(courses, models))] = courses
    first = next(iter(models))
    found = _in_one_unit(dict(sorted(made.items(), key=lambda one: -_worst(one[1], first))))
    names = list(dict.fromkeys(course.name for courses in found.values() for course in courses))
    if not found:
        return {}
    figure, axes = _panels(names, models, _time_words(found))
    return {title: partial(_show, figure, axes, names, courses, models) for title, courses in found.items()}


def chosen_records(name: str, draw: Mapping[str, Callable[[], Drawn]]) -> dict[str, Drawn]:
    """Return the figure of records to choose from under its name, the first one drawn; none without any."""
    if not draw:
        return {}
    figure = next(iter(draw.values()))()
    figure.choices = draw
    return {name: figure}


def _worst(courses: Sequence[Course], model: str) -> float:
    """Return how far a model is off, relative to what was measured, in the worst course."""
    if any(model not in course.residual for course in courses):
        return np.inf
    return max(float(np.std(course.residual[model]) / (np.std(course.measured) or 1.0)) for course in courses)


def _unfinished(courses: Sequence[Course], models: Mapping[str, Model]) -> list[str]:
    return [name for name in models if any(name not in course.modelled for course in courses)]


def _in_one_unit(found: Mapping[str, Sequence[Course]]) -> dict[str, list[Course]]:
    """Return courses whose displacements have one unit for all records, so that they can be compared."""
    largest: dict[str, float] = {}
    for course in (course for courses in found.values() for course in courses):
        largest[course.name] = max(largest.get(course.name, 0.0), float(np.abs(course.measured).max()))

    def in_unit(course: Course) -> Course:
        if course.unit != "m":
            return course
        scale, unit = (1e6, "µm") if largest[course.name] < _MICRO else (1e3, "mm")
        modelled, left = (
            {name: scale * values for name, values in of_models.items()}
            for of_models in (course.modelled, course.residual)
        )
        return Course(course.name, unit, course.time, scale * course.measured, modelled, left)

    return {title: [in_unit(course) for course in courses] for title, courses in found.items()}


def _time_words(found: Mapping[str, Sequence[Course]]) -> str:
    """Return what the axis of time is called: one name for all records."""
    struck = {any(course.time[0] < 0 for course in courses) for courses in found.values()}
    if struck == {True, False}:
        return "Time, after the impact where there is one [s]"
    return "Time after impact [s]" if struck == {True} else "Time [s]"


def _title(measurement: Measurement, unfinished: Sequence[str]) -> str:
    tension = measurement.tension.initial if measurement.tension is not None else measurement.preload_n
    parts = [measurement.file, measurement.test]
    parts += [f"{tension:.4g} N"] if tension is not None and measurement.test != "uncoupled" else []
    parts += ["held out"] if measurement.hold_out else []
    return ", ".join([*parts, *(f"{name} does not finish" for name in unfinished)])


def _courses(measurement: Measurement, models: Mapping[str, Model]) -> list[Course]:
    """Return what a record shows beside its simulations; nothing where it tells no tension to start from."""
    if not all(_tells_start(measurement, model) for model in models.values()):
        return []
    if measurement.link:
        return list(_link_forces(measurement, models))
    tried = {
        name: replay(model, measurement.with_cutoff(model.filter_cutoff_hz)) for name, model in models.items()
    }
    runs = {name: run for name, run in tried.items() if run.response.status == "ok"}
    measured = next(iter((runs or tried).values())).measurement
    return [*_motions(measured, runs), *_tension(measured, runs)]


def _tells_start(measurement: Measurement, model: Model) -> bool:
    """Return whether a record tells the tension to start from; of a cycled link its normal force does."""
    link = measurement.link
    driven = [name for name in model.structure.bolted_links if f"link_force_{name}" in link]
    if link and all(f"normal_force_{name}" in link for name in driven):
        return True
    return tension_known(model, measurement)


def _motions(measured: Measurement, runs: Mapping[str, Replay]) -> Iterator[Course]:
    shown = {name: displacements([run])[0] for name, run in runs.items()}
    start, stop = _window(measured, measured.rate_hz, _SHOWN_S)
    time = np.arange(measured.samples)[start:stop] / measured.rate_hz - (measured.impact_s or 0.0)
    for body in measured.motion:
        samples = measured.displacement(body)[start:stop]
        modelled = {name: found[body][start:stop] for name, found in shown.items()}
        own = {name: run.measurement.displacement(body)[start:stop] for name, run in runs.items()}
        left = {name: own[name] - modelled[name] for name in runs}
        yield Course(f"Displacement of {body}", "m", time, samples, modelled, left)


def _tension(record: Measurement, runs: Mapping[str, Replay]) -> Iterator[Course]:
    tension = record.tension
    simulated = [run.response.tension for run in runs.values()][:1]
    if tension is None or any(not isinstance(one, np.ndarray) or not one.size for one in simulated):
        return
    start, stop = _window(record, tension.rate_hz, 5 * _SHOWN_S)
    time = np.arange(len(tension.samples))[start:stop] / tension.rate_hz - (record.impact_s or 0.0)
    measured = tension.non_oscillatory[start:stop]
    modelled = {name: shown_tension(run, tension)[1][start:stop] for name, run in runs.items()}
    left = {name: measured - values for name, values in modelled.items()}
    yield Course("Non-oscillatory tension", "N", time, measured, modelled, left)


def _link_forces(measurement: Measurement, models: Mapping[str, Model]) -> Iterator[Course]:
    found = {name: driven_forces(model, measurement) for name, model in models.items()}
    for link, (_, measured) in next(iter(found.values())).items():
        time = measurement.link[f"link_force_{link}"].time
        modelled = {name: forces[link][0] for name, forces in found.items()}
        left = {name: measured - values for name, values in modelled.items()}
        yield Course(f"Force of {link}", "N", time, measured, modelled, left)


def _window(measurement: Measurement, rate_hz: float, after_s: float) -> tuple[int, int | None]:
    """Return first and last sample drawn: round an impact, or the whole record."""
    impact = measurement.impact_s
    if impact is None:
        return 0, None
    times = time_factor(measurement.strongest_hz)
    return int(max(impact - 0.05 * times, 0.0) * rate_hz), int((impact + after_s * times) * rate_hz)


@styled
def _panels(names: Sequence[str], models: Mapping[str, Model], time: str) -> tuple[Drawn, NDArray[Any]]:
    """Return a figure and its axes: courses on the left and what is left of them on the right, a row each."""
    figure, axes = panels(len(names), 2, 16.0 + 30.0 * len(names))
    for course, left in axes:
        left.sharex(course)
    figure.supxlabel(time, fontsize=7.5)
    lines = [Line2D([], [], color=MEASURED, lw=0.9, label="Measured")]
    lines += [Line2D([], [], **look, label=model) for model, look in zip(models, _LOOKS, strict=False)]
    figure.legend(handles=lines, loc="outside upper center", ncols=3)
    return figure, axes


@styled
def _show(
    figure: Drawn,
    axes: NDArray[Any],
    names: Sequence[str],
    courses: Sequence[Course],
    models: Mapping[str, Model],
) -> Drawn:
    """Draw the courses of a record in the place of those drawn before; rows may be empty."""
    there = {course.name: course for course in courses}
    for ax in axes.flat:
        for line in [*ax.lines]:
            line.remove()
        ax.relim()
        ax.autoscale()
    for row, name in zip(axes, names, strict=True):
        _draw(row, name, there.get(name), models)
    return figure


def _draw(row: Sequence[Axes], name: str, course: Course | None, models: Mapping[str, Model]) -> None:
    """Draw the same traces whether a record has a quantity or not: those to choose from are alike."""
    nothing = np.array([])
    course = course or Course(name, "", nothing, nothing, {}, {})
    unit = f" [{course.unit}]" if course.unit else " not measured"
    row[0].plot(*thinned(course.time, course.measured, _PIECES), color=MEASURED, lw=0.9, label="Measured")
    row[1].axhline(0.0, color=BACKGROUND, lw=0.5)
    for model, look in zip(models, _LOOKS, strict=False):
        for ax, values in ((row[0], course.modelled), (row[1], course.residual)):
            there = values.get(model, nothing)
            shown = thinned(course.time if len(there) else nothing, there, _PIECES)
            ax.plot(*shown, **look, label=model)
    row[0].set_title(name + unit)
    row[1].set_title("Residual" + (f" [{course.unit}]" if course.unit else ""))
    for ax in row:
        ax.ticklabel_format(axis="y", useOffset=False)
        if len(course.time):
            ax.set_xlim(course.time[0], course.time[-1])
        else:
            ax.set(xlim=(0.0, 1.0), ylim=(-1.0, 1.0))
