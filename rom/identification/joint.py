"""The joint of every coupled record, and its curves over tension: He et al. (2025), Section 3.2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rom.campaign.campaign import CampaignSettings
from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.identification.curve_fits import LawFit, fit_law
from rom.identification.form_selection import Form, fit_form, reference_tension
from rom.identification.modal import joint_damping, joint_stiffness
from rom.identification.output_error import OutputErrorFit
from rom.identification.record_spectra import LinearNames, given_value
from rom.identification.reduce import FirstMode, ReducedRecord
from rom.identification.spectral_model import CORNER, SpectralRecord
from rom.identification.uncoupled_priors import fit_near
from rom.model.laws import Law, constant_damping, constant_stiffness, logistic_damping, logistic_stiffness
from rom.model.power_of_tension import power_damping, power_stiffness


@dataclass(frozen=True)
class JointEstimate:
    """Joint of one coupled record: output error and, where the structure allows, the paper's modal formulas.

    `log_errors` are standard errors of ln k and ln c. `heaviest_damping_ratio` is the largest of the
    structure's modes: above 0.2 Eq. 7 is weak. `method` says which pair the curves use; output error does
    wherever it is to be had, since 1 % of first-mode frequency is 31 % of a stiff joint's k_C, and 10 % of
    its damping ratio 140 % of c_C.
    """

    file: str
    tension: float
    stiffness: float
    damping: float
    log_errors: tuple[float, float]
    heaviest_damping_ratio: float
    method: str
    first_mode: FirstMode | None
    modal_stiffness: float | None
    modal_damping: float | None


def joint_estimates(
    records: Sequence[ReducedRecord], linear: OutputErrorFit | None, settings: CampaignSettings
) -> tuple[JointEstimate, ...]:
    """Return the joint of every record whose tension is known, from the loosest to the tightest.

    Where none is known, all count as one level, at no tension: the joint then is a constant.

    Parameters
    ----------
    records : sequence of ReducedRecord
        The records.
    linear : OutputErrorFit
        The fit of the shared terms.
    settings : CampaignSettings
        Settings of the campaign.

    Returns
    -------
    tuple
        The loosest first.
    """
    if settings.bolt is None or linear is None:
        return ()
    link = settings.bolt.link
    seen = [r for r in records if f"{LinearNames.damping(link)}@{r.settings.file}" in linear.names]
    tensions = [_tension_of(record) for record in seen]
    if all(tension is None for tension in tensions):
        tensions = [0.0] * len(seen)
    estimates = [
        _joint_estimate(record, tension, linear, settings, link)
        for record, tension in zip(seen, tensions, strict=True)
        if tension is not None
    ]
    return tuple(sorted(estimates, key=lambda estimate: estimate.tension))


def _tension_of(record: ReducedRecord) -> float | None:
    """Return the tension at which a record's joint was seen [N]: the mean of before and after, or the nominal
    one.

    A gauge with a wrong zero may show less than none, a bolt may not.
    """
    if record.tensions is None:
        return record.settings.preload_n
    if record.settings.test == "loosening":  # the bolt has lost its tension before the ringing that tells
        return max(record.tensions.final, 0.0)
    return max(0.5 * (record.tensions.initial + record.tensions.final), 0.0)


def _joint_estimate(
    record: ReducedRecord, tension: float, linear: OutputErrorFit, settings: CampaignSettings, link: str
) -> JointEstimate:
    file = record.settings.file
    names = [f"{LinearNames.stiffness(link)}@{file}", f"{LinearNames.damping(link)}@{file}"]
    (stiffness, damping), covariance = linear.block(names)
    here = partial(shared_value, linear, settings, given=record.settings.given)
    heaviest = _heaviest_damping_ratio(here, settings, {link: (float(stiffness), float(damping))})
    modal_stiffness, modal_damping = _modal_joint(record.first_mode, here, settings, link)
    return JointEstimate(
        file, tension, float(stiffness), float(damping), (float(covariance[0, 0] ** 0.5), float(covariance[1,
        1] ** 0.5)), heaviest, "output error", record.first_mode, modal_stiffness, modal_damping,
    )  # fmt: skip


def _modal_joint(
    mode: FirstMode | None, here: Callable[[str], float], settings: CampaignSettings, link: str
) -> tuple[float | None, float | None]:
    """Return k_C and c_C by Eqs. 3, 9 and 10, for two bodies with a flexure each; None elsewhere."""
    ends = next(item.between for item in settings.link if item.name == link)
    flexures = [_flexure(settings, body) for body in ends]
    if mode is None or len(settings.body) != 2 or "ground" in ends or None in flexures:
        return None, None
    masses, stiffness, damping = (
        tuple(here(name(place)) for place in places)
        for name, places in (
            (LinearNames.mass, ends),
            (LinearNames.stiffness, flexures),
            (LinearNames.damping, flexures),
        )
    )
    frequency = mode.frequency.value
    k_c = float(joint_stiffness(frequency, (masses[0], masses[1]), (stiffness[0], stiffness[1])))
    c_c = float(
        joint_damping(frequency, mode.damping_ratio.value, k_c, (masses[0], masses[1]), (stiffness[0],
        stiffness[1]),
                      (damping[0], damping[1]))
    )  # fmt: skip
    return k_c, c_c


def _flexure(settings: CampaignSettings, body: str) -> str:
    """Return the one link that ties a body to ground, "" where there is none or several."""
    names = [
        link.name for link in settings.link if set(link.between) == {body, "ground"} and link.law == "linear"
    ]
    return names[0] if len(names) == 1 else ""


def shared_value(
    linear: OutputErrorFit, settings: CampaignSettings, name: str, given: Mapping[str, float] | None = None
) -> float:
    """Return a shared value of the fit, a mass as given, or what a record gives in its place.

    Parameters
    ----------
    linear : OutputErrorFit
        The fit of the shared terms.
    settings : CampaignSettings
        Settings of the campaign.
    name : str
        Name of the term.
    given : mapping of str to float
        What the record gives, by path.

    Returns
    -------
    float
        In SI.
    """
    own = given_value(given or {}, name)
    if own is not None:
        return own
    if name in linear.names:
        return linear.value(name)
    return next((body.mass_kg or 1.0 for body in settings.body if LinearNames.mass(body.name) == name), 0.0)


def _heaviest_damping_ratio(
    here: Callable[[str], float], settings: CampaignSettings, joint: Mapping[str, tuple[float, float]]
) -> float:
    """Return the largest damping ratio of the structure's complex modes; 1 for an overdamped one."""
    bodies = settings.body_names
    n = len(bodies)
    mass = np.diag([here(LinearNames.mass(body)) for body in bodies])
    matrices = {"stiffness": np.zeros((n, n)), "damping": np.zeros((n, n))}
    for link in settings.link:
        direction = np.array([(body == link.between[0]) - float(body == link.between[1]) for body in bodies])
        k, c = joint.get(link.name) or (
            here(LinearNames.stiffness(link.name)),
            here(LinearNames.damping(link.name)),
        )
        matrices["stiffness"] += k * np.outer(direction, direction)
        matrices["damping"] += c * np.outer(direction, direction)
    inverse = np.linalg.inv(mass)
    state = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-inverse @ matrices["stiffness"], -inverse @ matrices["damping"]]]
    )
    poles = np.linalg.eigvals(state)
    return float(np.max(-poles.real / np.maximum(np.abs(poles), 1e-300)))


def joint_curves(
    joint: Sequence[JointEstimate], linear: OutputErrorFit | None, settings: CampaignSettings
) -> tuple[LawFit | None, LawFit | None]:
    """Fit Eqs. 5 and 11 to the estimates; simpler forms where tensions lie too near to tell these.

    Parameters
    ----------
    joint : sequence of JointEstimate
        Stiffness and damping of the joint, by record.
    linear : OutputErrorFit
        The fit of the shared terms.
    settings : CampaignSettings
        Settings of the campaign.

    Returns
    -------
    tuple
        Laws of stiffness and damping; None where nothing is known.
    """
    if not joint or linear is None or settings.bolt is None:
        return None, None
    link = settings.bolt.link
    tension = np.array([estimate.tension for estimate in joint])
    files = [estimate.file for estimate in joint]
    stiffness, stiffness_covariance = linear.block(
        [f"{LinearNames.stiffness(link)}@{file}" for file in files]
    )
    damping, damping_covariance = linear.block([f"{LinearNames.damping(link)}@{file}" for file in files])
    of_k, of_c = (stiffness, stiffness_covariance), (damping, damping_covariance)
    levels = tension_levels(tension)
    if not levels:
        forms_k, forms_c = near_forms(tension, stiffness, damping)
        return fit_form(forms_k, tension, *of_k, files), fit_form(forms_c, tension, *of_c, files)
    scales = np.geomspace(tension[tension > 0].min(), tension.max(), 7)
    free_k, free_c = ["k_i", "alpha", "beta"], ["c_d", "c_i", "eta"]
    if levels == RULES.curve_levels:  # two levels tell two parameters: the shape between them is given
        scales = np.sqrt(scales[:1] * scales[-1:]) / 2
        free_k, free_c = ["k_i", "beta"], ["c_d", "c_i"]
    starts_k, starts_c = _logistic_starts(scales, tension, stiffness, damping)
    return (
        fit_law(starts_k, free_k, tension, *of_k, files),
        fit_law(starts_c, free_c, tension, *of_c, files),
    )


def near_forms(
    tension: FloatArray, stiffness: FloatArray, damping: FloatArray
) -> tuple[list[Form], list[Form]]:
    """Return the forms that tensions near to each other may tell: constants, powers, Eqs. 5 and 11.

    Parameters
    ----------
    tension : ndarray, shape (n,)
        Tensions of the records [N].
    stiffness, damping : ndarray, shape (n,)
        The joint's of every record [N/m], [N s/m].

    Returns
    -------
    tuple
        Forms of k_C(T) and of c_C(T).
    """
    k, c = float(np.exp(np.log(stiffness).mean())), float(np.exp(np.log(damping).mean()))
    of_k, of_c = [Form([constant_stiffness(k)], ("k",))], [Form([constant_damping(c)], ("c",))]
    reference = reference_tension(tension)
    if reference is None:
        return of_k, of_c
    scales = np.geomspace(tension[tension > 0].min(), tension.max(), 7)
    starts_k, starts_c = _logistic_starts(scales, tension, stiffness, damping)
    return (
        [
            *of_k,
            Form([power_stiffness(k, _slope(tension, stiffness, reference), reference)], ("k_r", "m")),
            Form(starts_k, ("k_i", "alpha", "beta")),
        ],
        [
            *of_c,
            Form([power_damping(c, _slope(tension, damping, reference), reference)], ("c_r", "m")),
            Form(starts_c, ("c_d", "c_i", "eta")),
        ],
    )


def _slope(tension: FloatArray, values: FloatArray, reference: float) -> float:
    """Return the exponent of a power of the tension through values."""
    return float(np.polyfit(np.log(np.maximum(tension, 0.01 * reference)), np.log(values), 1)[0])


def _logistic_starts(
    scales: FloatArray, tension: FloatArray, stiffness: FloatArray, damping: FloatArray
) -> tuple[list[Law], list[Law]]:
    """Return Eqs. 5 and 11 that change over scales of the tension [N]."""
    plateau = float(stiffness.max())
    low, high = float(damping[tension.argmax()]), float(damping[tension.argmin()])
    return (
        [logistic_stiffness(plateau, -1 / scale, b * scale) for scale in scales for b in (0.0, 0.5, 1.0)],
        [logistic_damping(2 * high - low, 2 * (high - low), -1 / scale) for scale in scales],
    )


def tension_levels(tension: FloatArray) -> int:
    """Return how many levels tensions [N] hold that differ by a tenth at least; 0 if too few or too near."""
    ordered = np.sort(tension[tension > 0])
    if len(ordered) < RULES.curve_levels or ordered[-1] < RULES.curve_span * ordered[0]:
        return 0
    return 1 + int(np.sum(np.diff(np.log(ordered)) > RULES.level_step))


def given_curves(
    parts: Sequence[SpectralRecord],
    linear: OutputErrorFit,
    joint: Sequence[JointEstimate],
    curves: tuple[LawFit, LawFit],
) -> OutputErrorFit:
    """Return the fit of the shared terms with every joint on its curve, where the joints left one open.

    A spring beside a bolt is told from it by the curve alone: each record knows but their sum. The limits
    stay as wide as the records leave them.

    Parameters
    ----------
    parts : sequence of SpectralRecord
        Spectra of the records.
    linear : OutputErrorFit
        The fit of the shared terms.
    joint : sequence of JointEstimate
        Stiffness and damping of the joint, by record.
    curves : tuple of LawFit
        Laws of stiffness and damping over tension.

    Returns
    -------
    OutputErrorFit
        The fit with the joints on their curves.
    """
    shared = [name for name in linear.names if "@" not in name and not name.startswith(CORNER)]
    tension = {estimate.file: estimate.tension for estimate in joint}
    unplaced = any(part.local and part.file not in tension for part in parts)
    several = len({name for part in parts for name in part.local}) > len(curves)
    if unplaced or several or not any(linear.relative_error(name) > RULES.left_open for name in shared):
        return linear
    fixed = []
    for part in parts:
        terms = []
        for term in part.terms:
            if term.name in part.local:
                law = curves[term.matrix == "damping"].law
                value = float(law(tension[part.file]))
                terms.append(replace(term, value=max(value, 0.0), free=False))
            else:
                terms.append(replace(term, value=linear.value(term.name)) if term.free else term)
        fixed.append(replace(part, terms=tuple(terms)))
    found = fit_near(fixed, linear.ties)
    before = np.diag([linear.relative_error(name) ** 2 for name in found.names])
    return replace(found, covariance=np.maximum(found.covariance, before))
