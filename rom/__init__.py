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
    from rom.campaign import Campaign, CampaignError, read_campaign, write_campaign
    from rom.identification import identify
    from rom.model import Model
    from rom.model_file import load_model
    from rom.parameters.he_2025 import paper_model
    from rom.residuals import compare, summarise
    from rom.simulation import Response

_HOME = {
    "Campaign": "rom.campaign",
    "CampaignError": "rom.campaign",
    "Model": "rom.model",
    "Response": "rom.simulation",
    "compare": "rom.residuals",
    "identify": "rom.identification",
    "load_model": "rom.model_file",
    "paper_model": "rom.parameters.he_2025",
    "read_campaign": "rom.campaign",
    "summarise": "rom.residuals",
    "write_campaign": "rom.campaign",
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
