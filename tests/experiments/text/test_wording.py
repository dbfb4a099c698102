"""Numbers, units, keys and equations as a reader sees them."""

from __future__ import annotations

import html
import re

import pytest

from experiments.text.equations import expression, math
from experiments.text.tables import unit_shown
from experiments.text.wording import label, number, with_limits


@pytest.mark.parametrize(
    ("units", "shown"),
    [
        (("s3/m4", "m^-4 s^3", "s^3 m^-4", "s**3/m**4"), "m<sup>−4</sup> s<sup>3</sup>"),
        (("N s/m", "N s m^-1", "N m^-1 s"), "N m<sup>−1</sup> s"),
        (("1/J", "J^-1"), "J<sup>−1</sup>"),
        (("1", "N/N"), ""),
        (("decades per cycle (5)",), "decades per cycle (5)"),
    ],
)
def test_one_unit_is_typeset_alike_however_it_was_written(units: tuple[str, ...], shown: str) -> None:
    assert {str(unit_shown(unit)) for unit in units} == {shown}


def test_numbers_and_keys_in_words() -> None:
    assert number(4.74e-7) == "4.740 × 10⁻⁷"
    assert number(-0.00922, 3) == "−0.00922"
    assert number(976300.0) == "976300"
    assert number(-0.0) == "0"
    assert number(None) == number(float("nan")) == "–"
    assert with_limits(11.7912, 11.5, 12.1) == ("11.8", "11.5 to 12.1")
    assert with_limits(4.0, None, None) == ("4", "–")
    assert label("tension_loss_n") == "Tension loss [N]"
    assert label("modal_damping_ns_per_m") == "Modal damping [N s/m]"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a - (b - c)", "a−(b−c)"),
        ("(a - b) - c", "a−b−c"),
        ("-(a + b) * c", "−(a+b)c"),
        ("a * -b", "a(−b)"),
        ("(-a) ** 2", "(−a)2"),
        ("2 * 3", "2·3"),
        ("max(T, 0) * abs(v) ** n", "T|v|n"),
        ("mu T tanh(v / v_s)", "μTtanh(vvs)"),
    ],
)
def test_expressions_keep_their_meaning(text: str, expected: str) -> None:
    shown = expression(text)
    assert shown is not None
    plain = html.unescape(re.sub(r"<[^>]+>", "", str(math(shown)))).replace("\u2062", "")
    assert plain == expected


@pytest.mark.parametrize(
    "text", ["", "a =", "__import__('os')", "a if b else c", "'x'", "a.b", "[1]", "(" * 500]
)
def test_what_is_no_expression_is_not_typeset(text: str) -> None:
    assert expression(text) is None


def test_initials_stay_capital() -> None:
    assert label("motion_nrmse_of_noise") == "Motion NRMSE of noise"
    assert label("tension_rmse_n") == "Tension RMSE [N]"
