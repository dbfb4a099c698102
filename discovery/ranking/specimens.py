"""What laws are fitted to and judged by: the tests of one bolt, or of several bolts of one kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from discovery.courses.frozen_motion import FrozenMotion, freeze, freeze_bolts
from discovery.criteria.criteria import Criteria
from discovery.criteria.ranking import RankingRules
from rom.campaign.campaign import Campaign
from rom.campaign.settings import CampaignSettings
from rom.identification.identify import Identification, identify_campaign
from rom.identification.reduce import reduce_records, tension_courses
from rom.model.model import Model
from rom.progress import Progress
from rom.signals.measured_records import judged_by, screened, with_something_left
from rom.signals.quality import Doubt
from rom.signals.tension_bins import TensionCourse

Stages = Callable[[str], Progress | None]


@dataclass(frozen=True, eq=False)
class Specimen:
    """A bolt: its campaign, the model identified from that, and its tension histories.

    Attributes
    ----------
    courses, hold_out : tuple of TensionCourse
        Of the records that are fitted, and of those that no fit sees.
    doubts : tuple of Doubt
        Why held-out records are set aside.
    rose : tuple of str
        Files of records that are not fitted since their tension rose.
    """

    campaign: Campaign
    found: Identification
    courses: tuple[TensionCourse, ...]
    hold_out: tuple[TensionCourse, ...]
    doubts: tuple[Doubt, ...]
    rose: tuple[str, ...]

    @property
    def model(self) -> Model:
        """The identified model, without its history."""
        return replace(self.found.model, identification=None)

    def notes(self, label: str = "") -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Lines on records set aside, and warnings, each with a label before it."""
        aside = (f"{doubt.file}: {doubt.message}" for doubt in (*self.found.set_aside, *self.doubts))
        rose = (f"{file}: its tension rose; not fitted" for file in self.rose)
        return tuple(label + line for line in aside), tuple(
            label + line for line in (*self.found.warnings, *rose)
        )


@dataclass(frozen=True, eq=False)
class Specimens:
    """All bolts, and their motion frozen together."""

    bolts: tuple[Specimen, ...]
    frozen: FrozenMotion
    hold_out: FrozenMotion | None

    @property
    def campaigns(self) -> Campaign | tuple[Campaign, ...]:
        """The campaign, or those of several bolts."""
        several = tuple(bolt.campaign for bolt in self.bolts)
        return several if len(several) > 1 else several[0]

    def notes(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Lines on records set aside, and warnings; of several bolts with the campaign's folder."""
        several = len(self.bolts) > 1
        notes = [bolt.notes(f"{bolt.campaign.path.name}: " if several else "") for bolt in self.bolts]
        return sum((aside for aside, _ in notes), ()), sum((warnings for _, warnings in notes), ())


def specimens(
    campaigns: Campaign | Sequence[Campaign], jobs: int, stage: Stages, tightening: bool, criteria: Criteria
) -> Specimens:
    """Identify every bolt's model and freeze the motion of all.

    Parameters
    ----------
    campaigns : Campaign or sequence of Campaign
        One bolt's, or those of several bolts of one kind.
    jobs : int
        Processes.
    stage : callable
        Called with the name of a stage; returns what is then called with (done, in all), or None.
    tightening : bool
        Whether records whose tension rose are fitted too.
    criteria : Criteria
        The numbers that decide.

    Raises
    ------
    ValueError
        If the campaigns are not of one kind, a bolt has no loosening record left, or all have too few.
    """
    several = (campaigns,) if isinstance(campaigns, Campaign) else tuple(campaigns)
    check_one_kind(several, tightening)
    bolts = tuple(specimen(campaign, jobs, stage, tightening, criteria) for campaign in several)
    least, count = criteria.ranking.least_cases, sum(len(bolt.courses) for bolt in bolts)
    empty = [str(bolt.campaign.path) for bolt in bolts if not bolt.courses]
    if count < least or empty:
        raise ValueError(
            f"{(empty or [str(several[0].path)])[0]}: found {0 if empty else count} loosening records with a "
            f"hit and a tension that may be fitted, expected {1 if len(bolts) > 1 else least:g} or more to "
            "compare tension laws"
        )
    frozen = _frozen(bolts, [bolt.courses for bolt in bolts], tightening, criteria)
    unseen = [bolt.hold_out for bolt in bolts]
    hold_out = _frozen(bolts, unseen, tightening, criteria) if any(unseen) else None
    return Specimens(bolts, frozen, hold_out)


def _frozen(
    bolts: Sequence[Specimen],
    courses: Sequence[tuple[TensionCourse, ...]],
    tightening: bool,
    criteria: Criteria,
) -> FrozenMotion:
    if len(bolts) == 1:
        return freeze(bolts[0].model, courses[0], signed=tightening, criteria=criteria)
    pairs = [(bolt.model, own) for bolt, own in zip(bolts, courses, strict=True)]
    return freeze_bolts(pairs, criteria=criteria)


def specimen(campaign: Campaign, jobs: int, stage: Stages, tightening: bool, criteria: Criteria) -> Specimen:
    """Identify one bolt's model and collect its tension histories.

    Parameters
    ----------
    campaign, jobs, stage, tightening, criteria
        As for `specimens`.
    """
    campaign = with_something_left(screened(judged_by(campaign, criteria.of_records), jobs))
    found = identify_campaign(campaign, jobs, stage("identifying"))
    unseen, doubts = _held_out(campaign, found, jobs, stage)
    kept, rose = _loosened(found.courses, tightening, criteria.ranking)
    return Specimen(campaign, found, kept, unseen, doubts, rose)


def check_one_kind(campaigns: Sequence[Campaign], tightening: bool = False) -> None:
    """Refuse campaigns that cannot be of several bolts of one kind.

    Raises
    ------
    ValueError
        With the first difference: in bodies, links or bolted link, or a campaign that is there twice; or if a
        structure has several bolted links.
    """
    if not campaigns:
        raise ValueError("found no campaign, expected one or more")
    if len(campaigns) > 1 and tightening:
        raise ValueError(
            "found several campaigns with tightening, expected one: a rate of either sign has no log"
        )
    for campaign in campaigns:
        check_one_bolt(campaign.settings, campaign.path)
    first = campaigns[0]
    for place, other in enumerate(campaigns[1:], 1):
        for (what, expected), (_, found) in zip(_kind(first), _kind(other), strict=True):
            if found != expected:
                raise ValueError(
                    f"{other.path}: found the {what} {found}, expected those of {first.path}, {expected}: "
                    "several campaigns are of bolts of one kind"
                )
        if any(_loosening(other) & _loosening(known) for known in campaigns[:place]):
            raise ValueError(f"{other.path}: found loosening records of another campaign, expected its own")


def check_one_bolt(settings: CampaignSettings, path: Path) -> None:
    """Refuse a structure with several bolted links, before any record is read.

    Raises
    ------
    ValueError
        With their names.
    """
    bolted = [link.name for link in settings.link if link.law == "bolted"]
    if len(bolted) > 1:
        raise ValueError(
            f"{path}: found {len(bolted)} bolted links ({', '.join(bolted)}), expected one: tension laws are "
            'ranked for one bolt a structure; declare links whose tension stays as it is "linear"'
        )


def _loosening(campaign: Campaign) -> set[str]:
    return {campaign.digests[r.file] for r in campaign.select("loosening") if r.file in campaign.digests}


def names_of_bolts(campaigns: Sequence[Campaign]) -> tuple[str, ...]:
    """Names of campaigns, or of their folders where two have the same name."""
    names = tuple(campaign.settings.name for campaign in campaigns)
    return names if len(set(names)) == len(names) else tuple(campaign.path.name for campaign in campaigns)


def _kind(campaign: Campaign) -> tuple[tuple[str, str], ...]:
    settings = campaign.settings
    links = ", ".join(f"{link.name} ({'-'.join(link.between)}, {link.law})" for link in settings.link)
    return (
        ("bodies", ", ".join(settings.body_names)),
        ("links", links),
        ("bolted link", settings.bolt.link if settings.bolt else "none"),
    )


def _held_out(
    campaign: Campaign, found: Identification, jobs: int, stage: Stages
) -> tuple[tuple[TensionCourse, ...], tuple[Doubt, ...]]:
    """Return the courses of the held-out loosening records, and why others of them are set aside."""
    records = campaign.select("loosening", hold_out=True)
    if not records:
        return (), ()
    reduced = list(reduce_records(campaign, records, jobs, stage("reading held-out records")))
    sound = [record for record in reduced if not record.doubts]
    doubts = tuple(doubt for record in reduced for doubt in record.doubts)
    return tension_courses(sound, found.course_noise, campaign.settings), doubts


def _loosened(
    courses: Sequence[TensionCourse], tightening: bool, rules: RankingRules
) -> tuple[tuple[TensionCourse, ...], tuple[str, ...]]:
    """Return the courses to fit, and the files of those that tightened beyond their noise."""
    rose = {
        course.file
        for course in courses
        if not tightening and course.change[-1] > rules.tightened * np.sqrt(course.covariance[-1, -1])
    }
    return tuple(c for c in courses if c.file not in rose), tuple(sorted(rose))
