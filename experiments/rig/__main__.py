"""What the rig can have undeclared, as a page: ``python -m experiments.rig > docs/rig.md``."""

from experiments.rig.kinds import Kind
from experiments.rig.undeclared import KINDS

_HEAD = """# Undeclared physics of the virtual rig

Printed by `python -m experiments.rig`. `boltlaw rig NEW_DIR --undeclared EFFECT[@PLACE][:key=value,...]`
(again for a second one) measures a campaign on a rig that has more than `campaign.toml` declares: a force,
another law of loosening, a reading in the measured tension that is none, or a faulty channel. Only the truth
file beside the folder names it, with all its numbers and how much it changes motion, loss and readings
(percent, against the rig without it, in six trial tests without noise).

    boltlaw rig campaign --cases 20 --undeclared coulomb-friction:F_c=2,mu=0 --undeclared hum@sensor:tension

From Python, `experiments.studies.rig` has `Undeclared("cubic-stiffness", "flexure_so", {"k3": 2e9})` for
`run(..., undeclared=(...,))`, and `draw(rng, name)` for one of random strength. The table has usual values
and, in brackets, the range of `draw`. A strength (bold) of zero is no effect, to the last bit; strengths
that are not given keep their usual values. In an equation the force pulls the first body of a link back; x,
v are relative there, T is the tension, k the link's stiffness, z, dz/dt an internal state, F and D the
joint's force and its viscous part, a its relative acceleration, `rate` the law's rate so far, `follow`
gamma(T) over its value at 100 N. The rig solves them with code of its own, sharp where a model may be
smooth. Effects in the joint, on the tension and in its channel are absent in tests without the bolt; phases
and the sizes of drifts are drawn anew for each record.
"""
_TITLES = {
    "force": "Forces in links and on bodies",
    "rate": "Changes of the tension law",
    "reading": "Readings of the tension",
    "fault": "Faulty channels",
}


def row(kind: Kind) -> str:
    """Return one line of a table."""
    families = dict.fromkeys((*kind.places, *kind.elsewhere))
    shown = dict(kind.numbers)
    lines = [_number(kind, name, *number) for name, number in shown.items()]
    for family in families:
        changed = kind.elsewhere.get(family, {})
        place = family.removeprefix("sensor:")
        lines += [f"{place}: {_number(kind, name, *number)}" for name, number in changed.items()]
    cells = [f"`{kind.name}`", ", ".join(kind.allowed), f"`{kind.equation}`", "<br>".join(lines)]
    if kind.outside:
        cells.append("<br>".join(f"{place}: {name}" for place, name in kind.nearest.items()))
    return f"| {' | '.join(cells)} |"


def _number(kind: Kind, name: str, value: float, unit: str, low: float, high: float) -> str:
    word = f"**{name}**" if name in kind.strengths else name
    reach = "" if low == high else f" ({low:g} to {high:g})"
    return f"{word} {value:g}{reach}{'' if unit == '1' else ' ' + unit}"


def page() -> str:
    """Return the page."""
    parts = [_HEAD]
    for outside in (False, True):
        for acts, title in _TITLES.items():
            rows = [row(kind) for kind in KINDS.values() if (kind.acts, kind.outside) == (acts, outside)]
            tail = ", outside the catalogue" if outside else ""
            columns = ["name", "place, the usual one first", "equation", "numbers"] + outside * [
                "nearly done by"
            ]
            head = f"| {' | '.join(columns)} |\n|{len(columns) * '---|'}"
            parts.append("\n".join([f"## {title}{tail}", head, *rows, ""]))
    return "\n".join(parts)


if __name__ == "__main__":
    print(page(), end="")
