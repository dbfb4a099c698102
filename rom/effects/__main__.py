"""The catalogue as a page: ``python -m rom.effects > docs/effects.md``."""

from __future__ import annotations

from rom.effects import CATALOGUE, Member, look_alikes
from rom.effects.member import OF_CHANNEL
from rom.model.laws import Parameter

_HEAD = """# The catalogue of effects

Printed by `python -m rom.effects`. What a model may lack: each effect with the places where it can enter,
its equation, and its parameters: default, range, unit. In an equation `F` is a force that pulls the first
body back, or what is added to a reading; `z1` an internal state; `rate` the rate of the tension law that is
changed, and `follow` its dependence on tension, 1 at 100 N. All parameters in bold at zero: no effect,
exactly. A star marks the core, which `boltlaw close` tries; without a bolt it tries all forces and
faults of force sensors. The others are there to simulate with. A bolted link is a `joint` even if it ends
at the ground; `ground` is any other link that ends there. How to add one: [own-effect.md](own-effect.md).
"""
_COLUMNS = "| name | enters | equation | parameters | look-alikes | source |"
_TITLES = {
    "force": "Forces in links and on bodies",
    "tension rate": "Changes of the tension law",
    "measured tension": "Readings of the tension",
    "sensor": "Faults of sensors",
}
_BOLTED = {"joint": "bolted joint", "ground": "ground, beside a bolt"}


def _parameter(member: Member, name: str, number: Parameter) -> str:
    word = f"**{name}**" if name in member.strengths else name
    low, high = number.bounds
    unit = {"1": "", OF_CHANNEL: " unit of y"}.get(number.unit, f" {number.unit}")
    return f"{word} {number.value:g} ({low:g} to {high:g}){unit}"


def _row(member: Member) -> str:
    at_ground = (
        [_parameter(member, *pair) for pair in member.ground.items()] if "joint" in member.places else []
    )
    numbers = "<br>".join(
        [
            *(_parameter(member, *pair) for pair in member.parameters.items()),
            *(f"at ground: {text}" for text in at_ground),
        ]
    )
    alike = ", ".join(look_alikes(member.name))
    star = "*" if member.core else ""
    equation = member.equation.replace("; ", ";<br>")
    cells = (
        f"`{member.name}`{star}",
        ", ".join(_BOLTED.get(place, place) if member.tensioned else place for place in member.places),
        equation,
        numbers,
        alike,
        member.source,
    )
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the catalogue."""
    parts = [_HEAD]
    for kind, title in _TITLES.items():
        rows = [_row(member) for member in CATALOGUE.values() if member.kind == kind]
        head = [
            "| name | enters | equation | parameters | look-alikes | source |",
            "|---|---|---|---|---|---|",
        ]
        parts.append("\n".join([f"## {title}", *head, *rows, ""]))
    print("\n".join(parts), end="")


if __name__ == "__main__":
    main()
