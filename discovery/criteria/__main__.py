"""Every number that decides, as a page: ``python -m discovery.criteria > docs/criteria.md``."""

from __future__ import annotations

from dataclasses import fields
from itertools import groupby

from discovery.criteria.criteria import CRITERIA

_HEAD = """# Criteria: every number that decides

Printed by `python -m discovery.criteria`. A number is here if another value could change which effect or law
is named, accepted or ranked. Each stands with its unit, what it decides, and where its value comes from. A
unit of 1 is a ratio or a probability; "2 ln L" is twice a log-likelihood. What the numbers are used for:
[what the model lacks](closed-loop.md), [which law of loosening](discovery.md).

`discovery.discover` and `discovery.close_loop` take other numbers:
`criteria=Criteria().changed(GROUP={"NAME": value})`.
"""
_COLUMNS = ["| name | value | unit | decides | from |", "|---|---|---|---|---|"]


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def main() -> None:
    """Print a table for each group."""
    titles = {group.name: type(getattr(CRITERIA, group.name)).__doc__ for group in fields(CRITERIA)}
    parts = [_HEAD]
    for group, rows in groupby(CRITERIA.rows(), key=lambda row: row[0]):
        parts += [f"## {group}", f"{titles[group]}\n", *_COLUMNS]
        for _, name, value, unit, meaning, measured in rows:
            parts.append(f"| `{name}` | {value:.6g} | {_cell(unit)} | {_cell(meaning)} | {_cell(measured)} |")
        parts.append("")
    print("\n".join(parts), end="")


if __name__ == "__main__":
    main()
