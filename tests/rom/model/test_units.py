"""Units read from text and written back."""

import pytest

from rom.effects import CATALOGUE
from rom.model.units import Powers, parse_unit, unit_text


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("1", (0, 0, 0)),
        ("N s2/m2", (1, -2, 2)),
        ("N/m3", (1, -3, 0)),
        ("1/N", (-1, 0, 0)),
        ("kg", (1, -1, 2)),
        ("m/s/s", (0, 1, -2)),
        ("N s^-1 m^-3.98", (1, -3.98, -1)),
        ("N·s**2 / m²", (1, -2, 2)),
    ],
)
def test_powers_of_a_unit(unit: str, expected: Powers) -> None:
    assert parse_unit(unit) == (1.0, expected)


@pytest.mark.parametrize(
    ("unit", "factor"), [("kN/mm", 1e6), ("[µm]", 1e-6), ("g", 9.80665), ("lbf/in", 4.4482216152605 / 0.0254)]
)
def test_factors_to_si(unit: str, factor: float) -> None:
    assert parse_unit(unit).factor == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize("unit", ["furlong", "", "/s", "N//m", "N ^2", "12", "1^2", "m^", "m2.", "N-m"])
def test_what_is_no_unit_is_refused(unit: str) -> None:
    with pytest.raises(ValueError, match="a unit must be made of"):
        parse_unit(unit)


def test_every_unit_of_a_force_in_the_catalogue_comes_back_as_it_was_written() -> None:
    for member in CATALOGUE.values():
        for number in member.parameters.values() if member.kind == "force" else ():
            powers = parse_unit(number.unit).powers
            assert parse_unit(unit_text(dict(zip(("N", "m", "s"), powers, strict=True)))) == (1.0, powers)
