"""What does not fit what a campaign declares, in words; and whether a model describes its records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from experiments.text.wording import mappings, number

Data = Mapping[str, Any]

LARGEST_ERROR = 0.5  # of the displacements, NRMSE: a model that is off by more describes nothing
_NAMED = 3  # records of one kind, before they are counted


def describes(errors: Data) -> bool:
    """Return whether a model's errors on a set of records let it pass for a description of them."""
    motion = errors.get("motion_nrmse")
    return not (isinstance(motion, float) and motion > LARGEST_ERROR) and not errors.get("failed")


def misfit(errors: Data, lost: Sequence[str], causes: Sequence[str], closed: bool = False) -> str | None:
    """Return one line that says why a model does not describe the records, and the likeliest cause.

    Parameters
    ----------
    errors : mapping
        Errors on training records.
    lost : sequence of str
        Kinds of test all of whose training records are set aside.
    causes : sequence of str
        What is likely, the most frequent first.
    closed : bool
        Whether the closed loop has looked for a missing effect.
    """
    why = []
    if lost:
        why.append(f"every training record of these tests is set aside: {', '.join(lost)}")
    elif causes and errors.get("records") == 0:
        why.append("every record is set aside")
    if errors.get("failed"):
        why.append(f"{errors['failed']} of {errors.get('records')} simulations did not finish")
    motion = errors.get("motion_nrmse")
    if isinstance(motion, float) and motion > LARGEST_ERROR:
        why.append(f"displacements are off by {number(100 * motion, 3)} %")
    if not why:
        return None
    cause = "the records show no cause: check masses and links of campaign.toml"
    if causes:
        cause = f"likeliest cause: {causes[0]}"
    elif not closed:
        cause += "; `boltlaw close` looks for a missing effect"
    return f"the model does not describe the records: {'; '.join(why)}; {cause}"


def lines(data: Data) -> list[str]:
    """Return a line for each kind of suspicion in each channel, with the records that raise it."""
    rows = mappings(data.get("suspicions"))
    groups: dict[tuple[str, str], list[Data]] = {}
    for row in rows:
        groups.setdefault((str(row.get("likely") or ""), str(row.get("channel"))), []).append(row)
    return [_line(likely, channel, same) for (likely, channel), same in groups.items()]


def _line(likely: str, channel: str, same: Sequence[Data]) -> str:
    files = list(dict.fromkeys(str(row.get("record")) for row in same))
    where = ", ".join(files[:_NAMED]) + (f" and {len(files) - _NAMED} more" if len(files) > _NAMED else "")
    finding = Counter(str(row.get("finding")) for row in same).most_common(1)[0][0]
    cause = f"{likely}, " if likely else ""
    return f"{cause}{channel} in {where}: {finding}"


def suspected_lines(data: Mapping[str, Any]) -> list[str]:
    """Return a line for people for each kind of suspicion."""
    return [f"  suspicion: {text}" for text in lines(data)]
