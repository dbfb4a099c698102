"""What a cell of the blind test adds to its closure: the truth, read only now, and what could be reached."""

from __future__ import annotations

import json
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from experiments.studies import drawn, rig
from rom.campaign.campaign import read_campaign

if TYPE_CHECKING:
    from discovery.loop.result import Closure


def measured(closure: Closure, campaign: Path) -> dict[str, Any]:
    """Return the truth beside a campaign, errors of a model that lacks nothing, and the program's digest."""
    truth = json.loads(rig.truth_path(campaign).read_text(encoding="utf-8"))["undeclared"]
    return {"program": program_digest(), "truth": truth, "oracle": _oracle(closure, campaign, truth)}


def program_digest() -> str:
    """Return a digest of the sources of ``rom`` and ``discovery``: results of one table should share it."""
    import discovery
    import rom

    found = sha256()
    for package in (rom, discovery):
        for path in sorted(Path(str(package.__file__)).parent.rglob("*.py")):
            found.update(path.read_bytes())
    return found.hexdigest()[:12]


def _oracle(closure: Closure, campaign: Path, truth: Sequence[Any]) -> dict[str, Any]:
    """Errors of a model that lacks nothing.

    Without effect that is the declared one; effects of the catalogue are put in and refitted; for others it
    is the declared model on a twin, a campaign of the same seed that was measured without them.
    """
    from experiments.studies.blind.oracle import declared_errors, oracle_errors

    if not truth:
        return {"kind": "declared", "hold_out": dict(closure.before["hold_out"])}
    try:
        with TemporaryDirectory(dir=campaign.parent) as scratch:
            twin = read_campaign(drawn.twin(campaign, Path(scratch) / "twin"))
            if all(one["in_catalogue"] for one in truth):
                kind, found = "refitted", oracle_errors(read_campaign(campaign), twin, truth)
            else:
                kind, found = "twin", [declared_errors(twin)]
    except Exception as fault:  # the closure stands without its measure
        return {"fault": f"{type(fault).__name__}: {fault}", "hold_out": None}
    told = zip(("hold_out", "true_values"), (dict(one["hold_out"]) for one in found), strict=False)
    return {"kind": kind, **dict(told)}
