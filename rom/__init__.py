"""Physics and signals: records in, reduced-order model out, and its fast simulation.

What `read_campaign`, `identify`, `paper_model` and `Model.simulate` return has ``summary()``, ``to_frame()``
and ``plot()``; a notebook shows the first two by itself.

Examples
--------
>>> import rom
>>> campaign = rom.read_campaign("campaign")
>>> model = rom.identify(campaign)  # doctest: +SKIP
>>> model = rom.paper_model()
>>> print(model.to_frame().loc["joint.damping.c_d", "value"].item())
1853.0
>>> len(model.plot().axes)
3
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rom.campaign.campaign import Campaign, CampaignError, read_campaign, write_campaign
    from rom.evaluation.error_measures import compare, summarise
    from rom.identification.identify import identify
    from rom.model.assembly import Response
    from rom.model.model import Model
    from rom.model_file import load_model
    from rom.parameters.he_2025 import paper_model

_HOME = {
    "Campaign": "rom.campaign.campaign",
    "CampaignError": "rom.campaign.campaign",
    "Model": "rom.model.model",
    "Response": "rom.model.assembly",
    "compare": "rom.evaluation.error_measures",
    "identify": "rom.identification.identify",
    "load_model": "rom.model_file",
    "paper_model": "rom.parameters.he_2025",
    "read_campaign": "rom.campaign.campaign",
    "summarise": "rom.evaluation.error_measures",
    "write_campaign": "rom.campaign.campaign",
}
__all__ = [
    "Campaign",
    "CampaignError",
    "Model",
    "Response",
    "compare",
    "identify",
    "load_model",
    "paper_model",
    "read_campaign",
    "summarise",
    "write_campaign",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that `import rom` is light."""
    if name not in _HOME:
        raise AttributeError(f"module 'rom' has no attribute {name!r}; it has {', '.join(__all__)}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    """Name the public interface."""
    return list(__all__)
