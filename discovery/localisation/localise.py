"""Where a residual lives: in which channel and test, at which frequency, tension and amplitude, when, and at
which place as a force.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from discovery.localisation.force_map import ForceMap, force_maps
from discovery.localisation.lines import (
    Profile,
    by_harmonic,
    by_place,
    by_time,
    line_correlation,
    places,
    repeatability,
    training_lines,
)
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

if TYPE_CHECKING:
    from discovery.residual.output_error import WhitenedResidual
    from discovery.residual.trajectory import MeasuredTrajectory
    from rom.identification.spectral_model import SpectralRecord

__all__ = ["COURSES", "PRELOADS_N", "Localisation", "Profile", "localise"]

_BANDS: Numerical[tuple[tuple[str, float, float], ...]] = (
    ("0 to 30 Hz", 0.0, 30.0),
    ("30 to 100 Hz", 30.0, 100.0),
    ("100 to 300 Hz", 100.0, 300.0),
    ("300 Hz and more", 300.0, np.inf),
)
PRELOADS_N: Numerical[tuple[float, ...]] = (30.0, 100.0, 300.0, 1000.0)  # [N]
_AMPLITUDES: Numerical[tuple[float, ...]] = (10.0, 50.0, 100.0, 200.0)  # [um]
COURSES = "tension_courses"


@dataclass(frozen=True)
class Localisation:
    """Mean square of the whitened residual, 1 at the noise floor, along each of several views.

    Attributes
    ----------
    by_channel, by_test, by_frequency, by_preload, by_amplitude : tuple of (str, float)
        A label and the mean square there.
    by_time, by_harmonic, by_place, by_sign : tuple of (str, float)
        The same by time since the impact, by harmonics of each record's dominant frequency, as a force on
        each body or in the bolted link, and of that link's force where its displacement is positive and
        negative (`discovery.localisation.lines`, `discovery.localisation.force_map`). Where bodies are
        driven there are no
        impacts, and no view along time since them and harmonics.
    whiteness_p : float
        Chance of so much correlation with the force where nothing is left but noise.
    total : float
        Mean square over all.
    numbers : tuple of (str, float)
        Errors beside those of the contract, by name: of campaigns that drive their bodies or links, and the
        mean square of what the law leaves over of the tension's courses, 1 being noise.
    repeats : tuple of (str, float)
        How alike the residuals of tests are that repeat each other; empty where none does.
    white : tuple of (str, float)
        How alike whitened lines side by side are, by kind of test, and what white noise reaches by chance.
    forces : tuple of ForceMap
        The force left unbalanced at every place, over the motion there.
    courses : mapping of str to tuple of (str, float)
        Mean squares of what the law leaves over of the tension's courses (`discovery.localisation.tension`).
    """

    by_channel: Profile
    by_test: Profile
    by_frequency: Profile
    by_preload: Profile
    by_amplitude: Profile
    whiteness_p: float
    total: float
    numbers: Profile = ()
    by_time: Profile = ()
    by_harmonic: Profile = ()
    by_place: Profile = ()
    by_sign: Profile = ()
    repeats: Profile = ()
    white: Profile = ()
    forces: tuple[ForceMap, ...] = ()
    courses: Mapping[str, Profile] = field(default_factory=dict)

    def as_dict(self) -> Mapping[str, object]:
        """Return plain values for a result file; what only some campaigns have is left out by others."""
        views = ("by_channel", "by_test", "by_frequency", "by_preload", "by_amplitude")
        more = ("by_time", "by_harmonic", "by_place", "by_sign")
        found: dict[str, object] = {view: dict(getattr(self, view)) for view in views}
        found |= {view: dict(profile) for view in more if (profile := getattr(self, view))}
        found |= {"whiteness_p": self.whiteness_p, "total": self.total, **dict(self.numbers)}
        found |= {**dict(self.repeats), **dict(self.white)}
        found |= {view: dict(profile) for view, profile in self.courses.items() if profile}
        return found | ({"forces": [one.as_dict() for one in self.forces]} if self.forces else {})


def localise(
    residual: WhitenedResidual,
    numbers: Mapping[str, float] | None = None,
    courses: Mapping[str, Profile] | None = None,
) -> Localisation:
    """Return where the residual on training records lives.

    Parameters
    ----------
    residual : WhitenedResidual
        What the model leaves over.
    numbers : mapping of str to float, optional
        Other errors, kept as they are.
    courses : mapping of str to tuple of (str, float), optional
        Views of the tension's misfit, kept as they are.

    Returns
    -------
    Localisation
        Mean squares over noise by each view; 1 is noise.
    """
    parts, criteria = training_lines(residual), residual.criteria
    squares = [(one.trace, one.part.frequency, one.rows) for one in parts]
    where = places(residual)
    forces = tuple(force_maps(where, parts, criteria))
    return Localisation(
        by_channel=_mean_squares(
            (body, m[:, :, k]) for t, _, m in squares for k, body in enumerate(t.bodies)
        ),
        by_test=_mean_squares((t.measurement.test, m) for t, _, m in squares),
        by_frequency=_mean_squares(
            (text, m[:, (f >= low) & (f < high)]) for _, f, m in squares for text, low, high in _BANDS
        ),
        by_preload=_mean_squares((_class(t.level, PRELOADS_N, "N"), m) for t, _, m in squares),
        by_amplitude=_mean_squares((_class(_peak(t), _AMPLITUDES, "um"), m) for t, _, m in squares),
        by_time=by_time(parts, criteria),
        by_harmonic=by_harmonic(parts, criteria),
        by_place=by_place(parts, where),
        by_sign=_by_sign(forces, [place.name for place in where if place.bolted]),
        whiteness_p=_whiteness([(one.part, one.rows) for one in parts]),
        total=float(np.mean(np.concatenate([m.ravel() for _, _, m in squares]) ** 2)),
        numbers=tuple((numbers or {}).items()),
        repeats=repeatability(parts, criteria),
        white=line_correlation(parts, criteria),
        forces=forces,
        courses=courses or {},
    )


def _by_sign(forces: Sequence[ForceMap], links: Sequence[str]) -> Profile:
    """Mean square of the force of the first bolted link that has moved, by the sign of its displacement."""
    one = next((force for force in forces if force.place in links), None)
    return () if one is None else sides_of(one)


def sides_of(force: ForceMap) -> Profile:
    """Mean square of a force by the sign of its displacement."""
    sides = (("positive", force.level_positive), ("negative", force.level_negative))
    return tuple((label, value) for label, value in sides if np.isfinite(value))


def _mean_squares(parts: Iterable[tuple[str, FloatArray]]) -> Profile:
    sums: dict[str, list[float]] = {}
    for label, values in parts:
        one = sums.setdefault(label, [0.0, 0.0])
        one[0] += float(np.sum(values**2))
        one[1] += values.size
    return tuple((label, total / count) for label, (total, count) in sorted(sums.items(), key=_rank) if count)


def _rank(item: tuple[str, list[float]]) -> tuple[int, str]:
    """Classes by their numbers, names by the alphabet."""
    digits = "".join(c if c.isdigit() else " " for c in item[0]).split()
    return (int(digits[0]) if digits else 0), item[0]


def _class(value: float, edges: Sequence[float], unit: str) -> str:
    return class_label(int(np.searchsorted(edges, value)), edges, unit)


def class_label(place: int, edges: Sequence[float], unit: str) -> str:
    """Return words for a class of values.

    Parameters
    ----------
    place : int
        Of the class: it ends at the edge of this place.
    edges : sequence of float
        Edges between the classes.
    unit : str
        Of the edges.

    Returns
    -------
    str
        Such as ``"10 to 30 N"``.
    """
    if place == 0:
        return f"0 to {edges[0]:g} {unit}"
    if place == len(edges):
        return f"{edges[-1]:g} {unit} and more"
    return f"{edges[place - 1]:g} to {edges[place]:g} {unit}"


def _peak(trace: MeasuredTrajectory) -> float:
    """Largest relative displacement of the first two bodies, or displacement of the one that moves [um]."""
    motions = list(trace.displacement.values())
    return float(np.abs(motions[0] - motions[1] if len(motions) > 1 else motions[0]).max()) * 1e6


def _whiteness(parts: Sequence[tuple[SpectralRecord, FloatArray]]) -> float:
    """Chance of the correlation between residual and force, were the residual noise.

    In every band, record and channel the residual's lines are summed in phase with the force's and a quarter
    turn off; of noise the sums are normal and independent (L. Ljung, System Identification, 1999, 16.6).
    """
    square, count = 0.0, 0
    for part, rows in parts:
        force = part.force[:, np.argmax(np.abs(part.force).sum(axis=0))]
        for _, low, high in _BANDS:
            inside = (part.frequency >= low) & (part.frequency < high)
            size = float(np.sqrt(np.sum(np.abs(force[inside]) ** 2)))
            if size > 0.0:
                sums = np.conj(force[inside]) @ (rows[0, inside] + 1j * rows[1, inside]) / size
                square += float(np.sum(np.abs(sums) ** 2))
                count += 2 * len(sums)
    return float(stats.chi2.sf(square, count)) if count else float("nan")
