"""What result files say where records do not fit what is declared, or a model does not describe them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from experiments.results import plain, write_result
from experiments.text.suspicions import misfit
from rom.campaign.campaign import Campaign
from rom.signals.measured_records import NothingLeftError, Screening, StoredCampaign
from rom.signals.suspicions import causes, nameless

Data = Mapping[str, Any]


def screening_of(campaign: Campaign) -> Screening:
    """Return what all records of a campaign told together; nothing if they were not asked."""
    found = campaign.screening if isinstance(campaign, StoredCampaign) else None
    return found or Screening()


def suspected(
    campaign: Campaign | Sequence[Campaign],
    errors: Data | None,
    reasons: Sequence[str] = (),
    closed: bool = False,
) -> dict[str, Any]:
    """Return keys of a result file: `suspicions`, and `unfit` where the model does not describe the records.

    Parameters
    ----------
    campaign : Campaign or sequence of Campaign
        As screened; of several each row says of which it is.
    errors : mapping, optional
        Of the model on training records; None where nothing was fitted.
    reasons : sequence of str
        What may be the cause where no suspicion is.
    closed : bool
        Whether the closed loop has looked for a missing effect.
    """
    several = (campaign,) if isinstance(campaign, Campaign) else tuple(campaign)
    found = [screening_of(one) for one in several]
    lost = tuple(dict.fromkeys(test for one in found for test in one.lost))
    suspicions = [s for one in found for s in one.suspicions]
    likely = causes(suspicions) or nameless(suspicions) or reasons
    unfit = misfit(errors or {}, lost, likely, closed)
    listed = [
        asdict(s) | ({"campaign": of.settings.name} if len(several) > 1 else {})
        for of, one in zip(several, found, strict=True)
        for s in one.suspicions
    ]
    rows = {"suspicions": plain(listed)}
    return rows | ({"unfit": unfit} if unfit else {})


def write_without_records(
    path: Path, kind: str, nothing: NothingLeftError, empty: Data, header: Mapping[str, Any]
) -> None:
    """Write a result file of a campaign all of whose training records are set aside: the reasons alone.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        Which format it has.
    nothing : NothingLeftError
        The reasons.
    empty : mapping
        What this kind of file says where there is nothing to say.
    header : mapping
        Campaign, seed, elapsed time, command and digest.
    """
    found = nothing.screening.suspicions
    aside = {f"{one.record}: {one.finding}" for one in found if one.sets_aside}
    content = {
        **empty,
        "set_aside": sorted(aside),
        "warnings": [],
        "suspicions": [asdict(one) for one in found],
        "unfit": str(nothing),
        "command": header["command"],
        "campaign_digest": header["campaign_digest"],
    }
    write_result(
        path, kind, content,
        campaign=header["campaign"], seed=header["seed"], elapsed_s=header["elapsed_s"],
    )  # fmt: skip
