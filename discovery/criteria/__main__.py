"""Every number that decides, as a page: ``python -m discovery.criteria > docs/criteria.md``."""

from __future__ import annotations

from dataclasses import fields

from discovery.criteria.criteria import CRITERIA
from rom.criteria.identification import RULES
from rom.criteria.number import Group

_HEAD = """# Criteria: every number that decides

Printed by `python -m discovery.criteria`. A number is here if another value could change which effect or law
is named, accepted or ranked, or which record is suspected, set aside or warned of. Each stands with its unit,
what it decides, and where its value comes from. A unit of 1 is a ratio or a probability; "2 ln L" is twice a
log-likelihood. What the numbers are used for:
[what the model lacks](closed-loop.md), [which law of loosening](discovery.md).

`discovery.discover` and `discovery.close_loop` take other numbers:
`criteria=Criteria().changed(GROUP={"NAME": value})`. Those of `identification` are the same for every
campaign.
"""
_COLUMNS = ["| name | value | unit | decides | from |", "|---|---|---|---|---|"]


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def groups() -> dict[str, Group]:
    """All groups of numbers that decide, by name."""
    return {**{one.name: getattr(CRITERIA, one.name) for one in fields(CRITERIA)}, "identification": RULES}


def main() -> None:
    """Print a table for each group."""
    parts = [_HEAD]
    for title, group in groups().items():
        parts += [f"## {title}", f"{type(group).__doc__}\n", *_COLUMNS]
        for name, value, unit, meaning, measured in group.rows():
            parts.append(f"| `{name}` | {value:.6g} | {_cell(unit)} | {_cell(meaning)} | {_cell(measured)} |")
        parts.append("")
    print("\n".join(parts), end="")


if __name__ == "__main__":
    main()
