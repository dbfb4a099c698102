"""A campaign of records into the paper's model: linear links, k_C(T), c_C(T), gamma per case and gamma(T), with limits.

He et al. (2025), Sections 3.1 to 3.5. The paper's own estimates (Eqs. 3, 9 and 10 from the first mode) are reported for every
coupled record; the curves are fitted to the joint output-error estimates, which hold where mode shapes do not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rom.campaign import Campaign, CampaignSettings
from rom.channels import FloatArray
from rom.law_fits import LawFit, fit_law, gamma_curve
from rom.laws import (
    Law,
    constant_damping,
    constant_stiffness,
    logistic_damping,
    logistic_loosening,
    logistic_stiffness,
    no_loosening,
    power_loosening,
)
from rom.linear import LinearNames, with_starts
from rom.loosening import GammaEstimate, LooseningCase, identify_gamma, refine_gamma_law
from rom.modal import joint_damping, joint_stiffness
from rom.model import LinkLaws, Model
from rom.output_error import OutputErrorFit, fit_output_error
from rom.quality import Doubt
from rom.reduction import FirstMode, Progress, ReducedRecord, Tensions, UncoupledTest, reduce_records
from rom.structure import Body, Link, Structure

MODAL_LIMIT = 0.2  # largest damping ratio at which Eq. 7 may be trusted
_Z95 = 1.959964
_LEAST_FOR_A_CURVE = 5
_LEAST_FOR_NOISE = 6


@dataclass(frozen=True)
class JointEstimate:
    """Joint of one coupled record: output error and, where the structure allows, the paper's modal formulas.

    `log_errors` are standard errors of ln k and ln c. `heaviest_damping_ratio` is the largest of the record's modes;
    `method` says what the curves use: "modal and output error agree to their errors" is not required, so it is always
    "output error" where that ratio exceeds 0.2 or the modal estimate has the wider limits.
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


@dataclass(frozen=True, eq=False)
class Identification:
    """All that an identification found; `model` is what it was for."""

    model: Model
    linear: OutputErrorFit | None
    uncoupled: tuple[UncoupledTest, ...] = ()
    joint: tuple[JointEstimate, ...] = ()
    stiffness_fit: LawFit | None = None
    damping_fit: LawFit | None = None
    gamma: tuple[GammaEstimate, ...] = ()
    gamma_case_fit: LawFit | None = None
    gamma_fit: LawFit | None = None
    set_aside: tuple[Doubt, ...] = ()
    warnings: tuple[str, ...] = ()
    records: tuple[str, ...] = field(default=(), repr=False)


def identify(campaign: Campaign, jobs: int = 1, progress: Progress | None = None) -> Model:
    """Identify the reduced-order model of a campaign from its training records.

    Parameters
    ----------
    campaign : Campaign
        As read by `read_campaign`.
    jobs : int
        Processes for reading and processing records; the numbers do not depend on it.
    progress : callable
        Called with (records done, records in all).

    Returns
    -------
    Model
        With 95 % limits on its parameters; `model.identification` holds every estimate behind it.

    Raises
    ------
    ValueError
        If no training record says anything of the structure.
    """
    return identify_campaign(campaign, jobs, progress).model


def identify_campaign(campaign: Campaign, jobs: int = 1, progress: Progress | None = None) -> Identification:
    """Return the identification with every estimate behind the model; see `identify`."""
    settings = campaign.settings
    records = list(reduce_records(campaign, campaign.select(hold_out=False), jobs, progress))
    set_aside = tuple(doubt for record in records for doubt in record.doubts)
    warnings = tuple(dict.fromkeys(text for record in records for text in record.warnings))
    records = [record for record in records if not record.doubts]
    linear = _fit_linear(records, settings)
    links = [entry for record in records for entry in record.link]
    if linear is None and not links:
        raise ValueError(f"{campaign.path}: found no training record of a moving body or a cycled link, expected one")
    joint = _joint_estimates(records, linear, settings)
    stiffness_fit, damping_fit = _joint_curves(joint, linear, settings)
    model, missing = _model(campaign, records, linear, stiffness_fit, damping_fit, joint, links)
    found = Identification(
        model, linear, tuple(r.uncoupled for r in records if r.uncoupled is not None), joint, stiffness_fit, damping_fit,
        set_aside=set_aside, warnings=(*warnings, *missing), records=tuple(r.settings.file for r in records),
    )  # fmt: skip
    cases = _loosening_cases(records)
    if model.structure.bolted_links and cases:
        found = _with_loosening(found, cases, settings.windows.final_s)
    return replace(found, model=replace(found.model, identification=found))


def _fit_linear(records: Sequence[ReducedRecord], settings: CampaignSettings) -> OutputErrorFit | None:
    parts = [record.spectra for record in records if record.spectra]
    return fit_output_error(with_starts(parts, settings)) if parts else None


def _joint_estimates(
    records: Sequence[ReducedRecord], linear: OutputErrorFit | None, settings: CampaignSettings
) -> tuple[JointEstimate, ...]:
    if settings.bolt is None or linear is None:
        return ()
    link = settings.bolt.link
    estimates = []
    for record in records:
        file, tension = record.settings.file, _tension_of(record)
        if f"{LinearNames.damping(link)}@{file}" in linear.names and tension is not None:
            estimates.append(_joint_estimate(record, tension, linear, settings, link))
    return tuple(sorted(estimates, key=lambda estimate: estimate.tension))


def _tension_of(record: ReducedRecord) -> float | None:
    """Return the tension at which a record's joint was seen [N]: the mean of before and after, or the nominal one."""
    if record.tensions is None:
        return record.settings.preload_n
    return 0.5 * (record.tensions.initial + record.tensions.final)


def _joint_estimate(
    record: ReducedRecord, tension: float, linear: OutputErrorFit, settings: CampaignSettings, link: str
) -> JointEstimate:
    file = record.settings.file
    names = [f"{LinearNames.stiffness(link)}@{file}", f"{LinearNames.damping(link)}@{file}"]
    (stiffness, damping), covariance = linear.block(names)
    heaviest = _heaviest_damping_ratio(linear, settings, {link: (float(stiffness), float(damping))})
    modal_stiffness, modal_damping = _modal_joint(record.first_mode, linear, settings, link)
    return JointEstimate(
        file, tension, float(stiffness), float(damping), (float(covariance[0, 0] ** 0.5), float(covariance[1, 1] ** 0.5)),
        heaviest, "output error", record.first_mode, modal_stiffness, modal_damping,
    )  # fmt: skip


def _modal_joint(
    mode: FirstMode | None, linear: OutputErrorFit, settings: CampaignSettings, link: str
) -> tuple[float | None, float | None]:
    """Return k_C and c_C by Eqs. 3, 9 and 10, which hold for two bodies with a flexure each; None elsewhere."""
    ends = next(item.between for item in settings.link if item.name == link)
    flexures = [_flexure(settings, body) for body in ends]
    if mode is None or len(settings.body) != 2 or "ground" in ends or None in flexures:
        return None, None
    masses, stiffness, damping = (
        tuple(_value(linear, settings, name(place)) for place in places)
        for name, places in ((LinearNames.mass, ends), (LinearNames.stiffness, flexures), (LinearNames.damping, flexures))
    )
    frequency = mode.frequency.value
    k_c = float(joint_stiffness(frequency, (masses[0], masses[1]), (stiffness[0], stiffness[1])))
    c_c = float(
        joint_damping(frequency, mode.damping_ratio.value, k_c, (masses[0], masses[1]), (stiffness[0], stiffness[1]),
                      (damping[0], damping[1]))
    )  # fmt: skip
    return k_c, c_c


def _flexure(settings: CampaignSettings, body: str) -> str:
    """Return the one link that ties a body to ground, "" where there is none or several."""
    names = [link.name for link in settings.link if set(link.between) == {body, "ground"} and link.law == "linear"]
    return names[0] if len(names) == 1 else ""


def _value(linear: OutputErrorFit, settings: CampaignSettings, name: str) -> float:
    """Return a shared value of the fit, or a mass as given."""
    if name in linear.names:
        return linear.value(name)
    return next((body.mass_kg or 1.0 for body in settings.body if LinearNames.mass(body.name) == name), 0.0)


def _heaviest_damping_ratio(
    linear: OutputErrorFit, settings: CampaignSettings, joint: Mapping[str, tuple[float, float]]
) -> float:
    """Return the largest damping ratio of the structure's complex modes; 1 for an overdamped one."""
    bodies = settings.body_names
    n = len(bodies)
    mass = np.diag([_value(linear, settings, LinearNames.mass(body)) for body in bodies])
    matrices = {"stiffness": np.zeros((n, n)), "damping": np.zeros((n, n))}
    for link in settings.link:
        direction = np.array([(body == link.between[0]) - float(body == link.between[1]) for body in bodies])
        k, c = joint.get(link.name) or (
            _value(linear, settings, LinearNames.stiffness(link.name)),
            _value(linear, settings, LinearNames.damping(link.name)),
        )
        matrices["stiffness"] += k * np.outer(direction, direction)
        matrices["damping"] += c * np.outer(direction, direction)
    inverse = np.linalg.inv(mass)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ matrices["stiffness"], -inverse @ matrices["damping"]]])
    poles = np.linalg.eigvals(state)
    return float(np.max(-poles.real / np.maximum(np.abs(poles), 1e-300)))


def _joint_curves(
    joint: Sequence[JointEstimate], linear: OutputErrorFit | None, settings: CampaignSettings
) -> tuple[LawFit | None, LawFit | None]:
    """Fit Eq. 5 and Eq. 11 to the joint's estimates; constants where there are too few tensions for a curve."""
    if not joint or linear is None or settings.bolt is None:
        return None, None
    link = settings.bolt.link
    tension = np.array([estimate.tension for estimate in joint])
    files = [estimate.file for estimate in joint]
    stiffness, stiffness_covariance = linear.block([f"{LinearNames.stiffness(link)}@{file}" for file in files])
    damping, damping_covariance = linear.block([f"{LinearNames.damping(link)}@{file}" for file in files])
    if len(joint) < _LEAST_FOR_A_CURVE or tension.max() < 3 * tension.min():
        k, c = float(np.exp(np.log(stiffness).mean())), float(np.exp(np.log(damping).mean()))
        return (
            fit_law([constant_stiffness(k)], ["k"], tension, stiffness, stiffness_covariance, files),
            fit_law([constant_damping(c)], ["c"], tension, damping, damping_covariance, files),
        )
    scales = np.geomspace(tension.min(), tension.max(), 7)
    plateau = float(stiffness.max())
    starts_k = [logistic_stiffness(plateau, -1 / scale, beta * scale) for scale in scales for beta in (0.0, 0.5, 1.0)]
    low, high = float(damping[tension.argmax()]), float(damping[tension.argmin()])
    starts_c = [logistic_damping(2 * high - low, 2 * (high - low), -1 / scale) for scale in scales]
    return (
        fit_law(starts_k, ["k_i", "alpha", "beta"], tension, stiffness, stiffness_covariance, files),
        fit_law(starts_c, ["c_d", "c_i", "eta"], tension, damping, damping_covariance, files),
    )


def _model(
    campaign: Campaign,
    records: Sequence[ReducedRecord],
    linear: OutputErrorFit | None,
    stiffness_fit: LawFit | None,
    damping_fit: LawFit | None,
    joint: Sequence[JointEstimate],
    cycled: Sequence[tuple[str, float, float]],
) -> tuple[Model, tuple[str, ...]]:
    """Return the model without a tension law yet, and a line for everything that no record tells."""
    settings = campaign.settings
    missing: list[str] = []
    bodies = []
    for body in settings.body:
        mass = body.mass_kg or (linear.value(name) if linear and (name := LinearNames.mass(body.name)) in linear.names else None)
        if mass is None:
            missing.append(f"body {body.name}: no training record tells its mass; 1 kg stands in")
        bodies.append(Body(body.name, mass or 1.0))
    laws: dict[str, LinkLaws] = {}
    uncoupled: dict[str, LinkLaws] = {}
    for link in settings.link:
        if link.law == "bolted":
            laws[link.name] = LinkLaws(
                stiffness_fit.law if stiffness_fit else constant_stiffness(link.stiffness_n_per_m or 0.0),
                damping_fit.law if damping_fit else constant_damping(link.damping_ns_per_m or 0.0),
                no_loosening(),
            )
            known = stiffness_fit is not None
        else:
            laws[link.name], known = _linear_laws(link.name, linear, cycled, bolted_in=True)
            without, seen = _linear_laws(link.name, linear, cycled, bolted_in=False)
            if seen:
                uncoupled[link.name] = without
                laws[link.name], known = (laws[link.name], True) if known else (without, True)
        if not known:
            missing.append(f"link {link.name}: no training record tells its stiffness or damping; zero stands in")
    structure = Structure(tuple(bodies), tuple(Link(x.name, x.between[0], x.between[1], x.law) for x in settings.link))
    cutoffs = {record.settings.test: record.cutoff_hz for record in records if record.cutoff_hz is not None}
    model = Model(
        structure=structure,
        link_laws=laws,
        filter_cutoff_hz=cutoffs,
        calibration=(settings.bolt.calibration or ()) if settings.bolt else (),
        windows={"initial_s": settings.windows.initial_s, "final_s": settings.windows.final_s},
        sampling=dict(settings.sampling),
        uncoupled_laws=uncoupled,
    )
    return model, tuple(missing)


def _linear_laws(
    link: str, linear: OutputErrorFit | None, cycled: Sequence[tuple[str, float, float]], *, bolted_in: bool
) -> tuple[LinkLaws, bool]:
    """Return constant laws of a link, and whether any record tells them; the dynamic fit goes before cycled records."""
    stiffness = LinearNames.stiffness(link, bolted_in=bolted_in)
    damping = LinearNames.damping(link)
    if linear is not None and (stiffness in linear.names or (bolted_in and damping in linear.names)):
        k = _constant(constant_stiffness, "k", linear, stiffness)
        return LinkLaws(k, _constant(constant_damping, "c", linear, damping)), True
    own = [(k, c) for name, k, c in cycled if name == link]
    if own and bolted_in:
        k_mean, c_mean = np.mean(own, axis=0)
        return LinkLaws(constant_stiffness(float(k_mean)), constant_damping(float(c_mean))), True
    return LinkLaws(constant_stiffness(0.0), constant_damping(0.0)), False


def _constant(law: type | object, parameter: str, linear: OutputErrorFit, name: str) -> Law:
    """Return a constant law with the fit's value and limits; zero where the structure has no such term."""
    assert callable(law)
    if name not in linear.names:
        zero: Law = law(0.0)
        return zero
    value, error = linear.value(name), linear.relative_error(name)
    made: Law = law(value)
    limited = replace(
        made.parameters[parameter], low=value * np.exp(-_Z95 * error), high=value * np.exp(_Z95 * error), source="identified"
    )
    return replace(made, parameters={parameter: limited})


def _loosening_cases(records: Sequence[ReducedRecord]) -> tuple[LooseningCase, ...]:
    """Return the cases for gamma with the standard error of their losses."""
    with_tension = [record for record in records if record.tensions is not None]
    noise = _loss_noise(with_tension)
    return tuple(
        LooseningCase(r.settings.file, r.struck, r.force, r.rate_hz, r.tensions.initial, r.tensions.final,
                      noise * r.tensions.slope)
        for r in with_tension
        if r.tensions is not None and r.force is not None and r.struck
    )  # fmt: skip


def _loss_noise(records: Sequence[ReducedRecord]) -> float:
    """Return the standard error of a measured loss in the unit of the strain, drift included.

    Coupled tests leave the tension alone, so what they seem to lose is that error; where they are few, batch means of
    the windows stand in, which do not see the drift between them.
    """
    scale = [(r.tensions, r.settings.test) for r in records if r.tensions is not None]
    quiet = np.array([(t.initial - t.final) / t.slope for t, test in scale if test == "coupled"])
    if len(quiet) >= _LEAST_FOR_NOISE:
        return float(np.sqrt(np.mean(quiet**2)))
    batch = [np.hypot(t.initial_error, t.final_error) / t.slope for t, _ in scale]
    return float(np.median(batch)) if batch else 0.0


def _with_loosening(
    found: Identification, cases: Sequence[LooseningCase], window_s: tuple[float, float]
) -> Identification:
    """Add gamma per case and gamma(T), fitted to the net-loosening cases and refined by re-simulation."""
    gamma = identify_gamma(found.model, cases, window_s)
    usable = [g for g in gamma if g.gamma > 0 and not g.at_bound and np.isfinite(g.log_error)]
    if not usable:
        return replace(found, gamma=gamma, warnings=(*found.warnings, "no case loosened: the tension law stays dT/dt = 0"))
    tension = np.array([g.initial for g in usable])
    values = np.array([g.gamma for g in usable])
    covariance = np.diag([min(g.log_error, 3.0) ** 2 for g in usable])
    files = [g.file for g in usable]
    if len(usable) < _LEAST_FOR_A_CURVE or tension.max() < 3 * tension.min():
        start = power_loosening(float(np.exp(np.log(values).mean())))
        case_fit = fit_law([start], ["gamma"], tension, values, covariance, files, gamma_curve)
    else:
        top, bottom = float(np.log10(values.max())), float(np.log10(values.min()))
        starts = [
            logistic_loosening(2 * top - bottom, 2 * (top - bottom), -1 / scale)
            for scale in np.geomspace(30.0, max(tension.max(), 60.0), 6)
        ]
        case_fit = fit_law(starts, ["gamma_d", "gamma_i", "rho"], tension, values, covariance, files, gamma_curve)
    by_file = {case.file: case for case in cases}
    link = found.model.structure.bolted_links[0]
    refined = refine_gamma_law(found.model, [by_file[file] for file in files], window_s, case_fit)
    laws = replace(found.model.link_laws[link], tension_rate=refined.law)
    model = replace(found.model, link_laws={**found.model.link_laws, link: laws})
    return replace(found, model=model, gamma=gamma, gamma_case_fit=case_fit, gamma_fit=refined)
