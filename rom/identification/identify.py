"""A campaign of records into the paper's model: links, k_C(T), c_C(T), gamma per case, gamma(T), with limits.

He et al. (2025), Sections 3.1 to 3.5. The paper's own estimates (Eqs. 3, 9 and 10 from the first mode) are
reported for every coupled record; the curves are fitted to the joint output-error estimates, which hold where
mode shapes do not.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

from rom.campaign.campaign import Campaign, CampaignSettings
from rom.criteria.identification import RULES
from rom.effects import CATALOGUE
from rom.identification import undetermined
from rom.identification.at_rest import STILL, model_at_rest
from rom.identification.curve_fits import LawFit
from rom.identification.force_balance import balances_of, declared_model, is_driven, noise_share
from rom.identification.free_decay import fit_free_decay, free_model, is_free, ring_downs
from rom.identification.gamma_law import fitted_numbers, loosening_law
from rom.identification.gamma_per_case import GammaEstimate, LooseningCase
from rom.identification.joint import JointEstimate, given_curves, joint_curves, joint_estimates
from rom.identification.link_laws import bolted_laws, linear_laws, mean_laws
from rom.identification.modal_model import IdentifiedMode, identify_modes
from rom.identification.output_error import OutputErrorFit
from rom.identification.record_spectra import LinearNames
from rom.identification.reduce import (
    ReducedRecord,
    UncoupledTest,
    common_cutoffs,
    loosening_cases,
    reduce_records,
    tension_courses,
)
from rom.identification.small_impacts import losses_of_small_impacts
from rom.identification.spectral_model import SpectralRecord
from rom.identification.starting_values import best_starts
from rom.identification.uncoupled_priors import fit_near, flexure_ties, unsettled, without_modes
from rom.jobs import processes_for
from rom.model.description import LinkLaws
from rom.model.effect import SensorFault
from rom.model.laws import Law, constant_damping, constant_stiffness, no_loosening
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure
from rom.one_thread import one_threaded
from rom.progress import Progress
from rom.result_views import HasViews
from rom.signals.measured_records import screened, with_something_left, with_stored_records
from rom.signals.quality import Doubt
from rom.signals.sensor_correction import faults_of
from rom.signals.tension_bins import CourseNoise, TensionCourse, course_noise


@dataclass(frozen=True, eq=False)
class Identification(HasViews):
    """All that an identification found; `model` is what it was for.

    `unsettled` are reasons to doubt that its numbers are near those of the structure, none for a sound one:
    numbers that the uncoupled tests contradict, or much misfit without such tests. Misfit alone is none: a
    good start may lack an effect. `rom.identification.uncoupled_priors.unlikely` asks it of a later model.
    `declared` is a tension law of given form in place of gamma(T); `modes` are those of a campaign of modes.
    """

    model: Model
    linear: OutputErrorFit | None
    uncoupled: tuple[UncoupledTest, ...] = ()
    joint: tuple[JointEstimate, ...] = ()
    stiffness_fit: LawFit | None = None
    damping_fit: LawFit | None = None
    gamma: tuple[GammaEstimate, ...] = ()
    gamma_case_fit: LawFit | None = None
    gamma_fit: LawFit | None = None
    declared: Law | None = None
    courses: tuple[TensionCourse, ...] = field(default=(), repr=False)
    course_noise: CourseNoise | None = None
    set_aside: tuple[Doubt, ...] = ()
    warnings: tuple[str, ...] = ()
    unsettled: tuple[str, ...] = ()
    records: tuple[str, ...] = field(default=(), repr=False)
    modes: tuple[IdentifiedMode, ...] = ()

    @property
    def settled(self) -> bool:
        """Whether nothing speaks against the numbers as a start."""
        return not self.unsettled

    @property
    def law_numbers(self) -> tuple[str, ...]:
        """Numbers of the tension law that a fit to tension histories may move."""
        if self.declared is not None:
            return fitted_numbers(self.declared)
        return () if self.gamma_fit is None else self.gamma_fit.free

    def with_model(self, model: Model, progress: Progress | None = None) -> Identification:
        """The same with another model, gamma(T) fitted anew beside what changes it there.

        ``progress`` is called with the number of cases whose gamma is found, and their total.
        Hits are those without the faults that the model has beyond the identification, alike in all records.
        """
        changed = replace(self, model=model)
        if len(model.structure.bolted_links) != 1 or not self.courses:
            return changed
        out = {effect.path for effect in self.model.effects}
        faults = [f for f in faults_of(model) if f.path not in out and not CATALOGUE[f.name].by_record]
        cases = [
            LooseningCase.of(course, [f for f in faults if f.channel == f"force_{course.body}"])
            for course in self.courses
            if not course.hold_out
        ]
        return _with_loosening(changed, cases, self.courses[0].final_window, progress)

    def refitted_to(
        self,
        records: Sequence[tuple[SpectralRecord, ...]],
        settings: CampaignSettings,
        acted_in: Collection[str] = (),
    ) -> Model:
        """The model with linear links and joint curves fitted anew, started from records, priors as here.

        Parameters
        ----------
        records : sequence of tuple of SpectralRecord
            Parts of every record; their forces may be more than measured, such as an effect's beside.
        settings : CampaignSettings
            Settings of the campaign.
        acted_in : collection of str
            Links and bodies in or on which effects act: not tied to their own modes.

        Returns
        -------
        Model
            With the same law of the tension.
        """
        assert self.linear is not None
        parts = best_starts(records, settings)
        linear = fit_near(parts, without_modes(self.linear.ties, acted_in))
        files = {part.file for part in parts}
        joint = [estimate for estimate in self.joint if estimate.file in files]
        curves = joint_curves(joint, linear, settings)
        laws, alone = dict(self.model.link_laws), dict(self.model.uncoupled_laws)
        for link in settings.link:
            if settings.bolt is not None and link.name == settings.bolt.link:
                fitted = bolted_laws(link, curves, ())
                if fitted is not None:
                    laws[link.name] = replace(fitted, tension_rate=laws[link.name].tension_rate)
            elif link.law != "bolted":
                laws[link.name] = linear_laws(link, linear, (), bolted_in=True) or laws[link.name]
                if link.name in alone:
                    alone[link.name] = linear_laws(link, linear, (), bolted_in=False) or alone[link.name]
        structure = replace(self.model.structure, bodies=_bodies(settings, linear)[0])
        return replace(self.model, structure=structure, link_laws=laws, uncoupled_laws=alone)


def identify(campaign: Campaign, jobs: int | None = None, progress: Progress | None = None) -> Model:
    """Identify the reduced-order model of a campaign from its training records.

    Parameters
    ----------
    campaign : Campaign
        As read by `read_campaign`.
    jobs : int
        Processes, on which no number depends; if not given all cores, one for less than 50 MB of records.
    progress : callable
        Called with (records done, records in all), then the same of the cases whose gamma is sought.

    Returns
    -------
    Model
        With 95 % limits on its parameters; `model.identification` holds every estimate behind it.

    Raises
    ------
    ValueError
        If no training record says anything of the structure.
    """
    files = (campaign.path / record.file for record in campaign.settings.record)
    return identify_campaign(campaign, processes_for(jobs, files), progress).model


@one_threaded
@with_stored_records
def identify_campaign(
    campaign: Campaign,
    jobs: int = 1,
    progress: Progress | None = None,
    faults: Sequence[SensorFault] = (),
    law: Law | None = None,
) -> Identification:
    """Return the identification with every estimate behind the model; see `identify`.

    Parameters
    ----------
    campaign, jobs, progress
        As for `identify`.
    faults : sequence of SensorFault
        Faults of sensors that are known: taken out of impact tests, and in the model.
    law : Law
        Form of the tension law, its numbers the start; gamma(T) of the paper if not given.

    Returns
    -------
    Identification
        `Identification.with_model` and `Identification.refitted_to` go on from it.

    Raises
    ------
    ValueError
        As for `identify`.
    """
    campaign = with_something_left(screened(campaign, jobs))
    if campaign.settings.is_at_rest:
        files = tuple(record.file for record in campaign.select(hold_out=False))
        model = model_at_rest(campaign)
        return _without_spectra(Identification(model, None, warnings=(STILL,), records=files))
    if campaign.settings.modes is not None:
        return _of_modes(campaign)
    if is_free(campaign):
        return _of_free(campaign)
    if is_driven(campaign) and (driven := _of_driven(campaign)) is not None:
        return driven
    settings = campaign.settings
    reduced = list(reduce_records(campaign, campaign.select(hold_out=False), jobs, progress, faults))
    records = [record for record in reduced if not record.doubts]
    found = replace(
        _of_impacts(campaign, records),
        declared=law,
        set_aside=tuple(doubt for record in reduced for doubt in record.doubts),
        records=tuple(record.settings.file for record in records),
    )
    of_records = dict.fromkeys(text for record in reduced for text in record.warnings)
    found = replace(found, warnings=(*of_records, *found.warnings))
    links, cases = found.model.structure.bolted_links, loosening_cases(records)
    if len(links) > 1:
        text = "several bolted links, one measured tension: no law of loosening is identified"
        found = replace(found, warnings=(*found.warnings, text))
    elif links and cases:
        found = _with_loosening(found, cases, settings.windows.final_s, progress)
    return replace(found, model=replace(found.model, effects=tuple(faults), identification=found))


def _of_impacts(campaign: Campaign, records: Sequence[ReducedRecord]) -> Identification:
    """Return what sound records tell of links and joint, by output error; no law of loosening yet."""
    settings = campaign.settings
    parts = _started(records, settings)
    linear = fit_near(parts, flexure_ties(records, settings)) if parts else None
    if linear is None and not any(record.link for record in records):
        raise ValueError(
            f"{campaign.path}: found no training record of a moving body or a cycled link, expected one"
        )
    joint = joint_estimates(records, linear, settings)
    stiffness_fit, damping_fit = joint_curves(joint, linear, settings)
    doubtful = (
        *undetermined.of_links(linear, settings),
        *undetermined.few_joints(joint, (stiffness_fit, damping_fit)),
    )
    if linear is not None and stiffness_fit is not None and damping_fit is not None:
        linear = given_curves(parts, linear, joint, (stiffness_fit, damping_fit))
    model, missing = _model(campaign, records, linear, (stiffness_fit, damping_fit))
    far_off = unsettled(model, linear) if linear is not None else ()
    model, unlimited = undetermined.without_conditional_limits(model, linear, bool(far_off))
    noise = course_noise(
        [r.bins for r in records if r.bins and r.settings.test == "coupled"],
        [r.bins_before for r in records if r.bins_before],
    )
    return Identification(
        model=model,
        linear=linear,
        uncoupled=tuple(record.uncoupled for record in records if record.uncoupled is not None),
        joint=joint,
        stiffness_fit=stiffness_fit,
        damping_fit=damping_fit,
        courses=tension_courses(records, noise, settings),
        course_noise=noise,
        warnings=(
            *missing, *undetermined.vanished(model, settings), *doubtful, *far_off, *unlimited,
            *undetermined.untensioned(records, settings), *losses_of_small_impacts(records)
        ),
        unsettled=far_off,
    )  # fmt: skip


def _of_driven(campaign: Campaign) -> Identification | None:
    """Return the declared model of a campaign without a bolt, by the balance of its forces.

    None where a displacement is too noisy to be differentiated: the output error does without.
    """
    balances, doubts = balances_of(campaign)
    if noise_share(balances) > RULES.noise_bias:
        return None
    model, lines = declared_model(balances)
    files = tuple(r.settings.file for r in balances.records if not r.settings.hold_out)
    found = Identification(model, None, set_aside=doubts, warnings=lines, records=files)
    return _without_spectra(found)


def _without_spectra(found: Identification) -> Identification:
    """Return an identification that no motion was followed for, its model with all that is behind it."""
    return replace(found, model=replace(found.model, identification=found))


def _of_free(campaign: Campaign) -> Identification:
    """Return the declared model of a campaign of ring-downs, by output error."""
    rings, doubts = ring_downs(campaign)
    fit = fit_free_decay(rings, campaign)
    model, files = free_model(campaign.settings, fit), tuple(ring.file for ring in rings if not ring.hold_out)
    found = Identification(model, None, set_aside=doubts, warnings=fit.lines, records=files)
    return _without_spectra(found)


def _of_modes(campaign: Campaign) -> Identification:
    """Return the model of a campaign's modes, by output error of all sensors together."""
    modes = identify_modes(campaign)
    files = tuple(ring.file for ring in modes.rings if not ring.hold_out)
    found = Identification(modes.model, None, set_aside=modes.doubts, warnings=modes.lines, records=files)
    return _without_spectra(replace(found, modes=modes.modes))


def _started(records: Sequence[ReducedRecord], settings: CampaignSettings) -> tuple[SpectralRecord, ...]:
    parts = [record.spectra for record in records if record.spectra]
    return best_starts(parts, settings) if parts else ()


def _model(
    campaign: Campaign,
    records: Sequence[ReducedRecord],
    linear: OutputErrorFit | None,
    joint: tuple[LawFit | None, LawFit | None],
) -> tuple[Model, tuple[str, ...]]:
    """Return the model without a tension law yet, and a line for everything that no record tells."""
    settings = campaign.settings
    cycled = [entry for record in records for entry in record.link]
    missing: list[str] = []
    laws: dict[str, LinkLaws] = {}
    uncoupled: dict[str, LinkLaws] = {}
    for link in settings.link:
        if link.law == "bolted" and settings.bolt is not None and link.name != settings.bolt.link:
            found, without = mean_laws(link.name, linear), None
            missing.append(
                f"link {link.name}: its tension is not measured; stiffness and damping are constants"
            )
        elif link.law == "bolted":
            found, without = bolted_laws(link, joint, cycled), None
        else:
            without = linear_laws(link, linear, cycled, bolted_in=False)
            found = linear_laws(link, linear, cycled, bolted_in=True) or without
        if without is not None:
            uncoupled[link.name] = without
        if found is None:
            missing.append(
                f"link {link.name}: no training record tells its stiffness or damping; zero stands in"
            )
        rate = no_loosening() if link.law == "bolted" else None
        laws[link.name] = found or LinkLaws(constant_stiffness(0.0), constant_damping(0.0), rate)
    bodies, unknown = _bodies(settings, linear)
    model = Model(
        structure=Structure(bodies, tuple(Link(x.name, *x.between, x.law) for x in settings.link)),
        link_laws=laws,
        filter_cutoff_hz=common_cutoffs(records),
        calibration=(settings.bolt.calibration or ()) if settings.bolt else (),
        windows=dict(settings.windows),
        sampling=dict(settings.sampling),
        uncoupled_laws=uncoupled,
    )
    return model, (*unknown, *missing)


def _bodies(
    settings: CampaignSettings, linear: OutputErrorFit | None
) -> tuple[tuple[Body, ...], tuple[str, ...]]:
    bodies, unknown = [], []
    for body in settings.body:
        mass, name = body.mass_kg, LinearNames.mass(body.name)
        if mass is None and linear is not None and name in linear.names:
            mass = linear.value(name)
        if mass is None:
            unknown.append(f"body {body.name}: no training record tells its mass; 1 kg stands in")
        bodies.append(Body(body.name, mass or 1.0))
    return tuple(bodies), tuple(unknown)


def _with_loosening(
    found: Identification,
    cases: Sequence[LooseningCase],
    window_s: tuple[float, float],
    progress: Progress | None = None,
) -> Identification:
    """Add gamma per case, and gamma(T) or the declared form with the law."""
    model = found.model
    loosening = loosening_law(model, cases, window_s, progress, found.declared)
    if loosening.law is not None:
        model = replace(model.with_tension_law(loosening.law), rate_uncertainty=loosening.rate_uncertainty)
    return replace(
        found,
        model=model,
        gamma=loosening.gamma,
        gamma_case_fit=loosening.case_fit,
        gamma_fit=loosening.fit,
        warnings=(*found.warnings, *loosening.warnings),
    )
