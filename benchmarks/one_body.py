"""Campaigns of one driven body on one linear link to ground, its displacement measured."""

from __future__ import annotations

from collections.abc import Collection

from rom.campaign.campaign import FORMAT, CampaignSettings
from rom.campaign.channels import Channel, FloatArray


def settings(
    name: str, body: str, link: str, rate_hz: float, files: Collection[str], held_out: Collection[str]
) -> CampaignSettings:
    """Return the settings of such a campaign.

    Parameters
    ----------
    name, body, link : str
        Of the campaign, its body and its link.
    rate_hz : float
        Sampling rate [Hz].
    files, held_out : collection of str
        Records, and those among them that are held out.
    """
    return CampaignSettings.model_validate(
        {
            "format": FORMAT,
            "name": name,
            "body": [{"name": body}],
            "link": [{"name": link, "between": [body, "ground"], "law": "linear"}],
            "sampling": {"motion_rate_hz": rate_hz, "tension_rate_hz": rate_hz, "pretrigger_s": 0.0},
            "record": [
                {"file": file, "test": "driven", "bodies": [body], "hold_out": file in held_out}
                for file in files
            ],
        }
    )


def channels(body: str, force: FloatArray, displacement: FloatArray, rate_hz: float) -> dict[str, Channel]:
    """Return the channels of one of its records.

    Parameters
    ----------
    body : str
        The body.
    force, displacement : ndarray, shape (samples,)
        [N] and [m].
    rate_hz : float
        Sampling rate [Hz].
    """
    shown = {f"force_{body}": force, f"displacement_{body}": displacement}
    return {name: Channel(name, samples, rate_hz) for name, samples in shown.items()}
