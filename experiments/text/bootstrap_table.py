"""The table of a closure's bootstrap; every number comes from closure.json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from discovery.views.closure_summary import place_words
from experiments.text.tables import Table, unit_shown
from experiments.text.wording import mapping, mappings, with_limits


def bootstrap_table(data: Mapping[str, Any]) -> Table:
    """Return how often replicates name each effect again, and the limits that they give its numbers."""
    found = mapping(data.get("bootstrap"))
    rows = tuple(
        (
            f"{effect['name']}, {place_words(effect['enters'])}",
            f"{effect['named']} of {found['replicates']}",
            str(effect["first"]),
            name,
            *with_limits(number["value"], number["low"], number["high"]),
            unit_shown(str(number["unit"])),
        )
        for effect in mappings(found.get("effects"))
        for name, number in effect["parameters"].items()
    )
    note = (
        "Campaigns simulated with the refined model, noise and variability between tests drawn anew, each "
        "closed as this one was. Values are less the bias that these closures show; limits hold given that "
        "the effect is named."
    )
    heads = ("Effect", "Named again", "First", "", "Value", "95 % limits", "Unit")
    return Table("Bootstrap of the closure", heads, rows, note=note)
