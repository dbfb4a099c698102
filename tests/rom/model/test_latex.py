"""Expressions as LaTeX: every sign and bracket that the arithmetic needs."""

from __future__ import annotations

import pytest

from rom.effects import CATALOGUE
from rom.model.latex import latex_of
from rom.parameters.he_2025 import paper_model


@pytest.mark.parametrize(
    ("expression", "latex"),
    [
        ("-a * abs(D * v) * max(T, 0)", r"-a \left|D v\right| T"),
        ("a * -2 - (b - c)", r"a \left(-2\right) - \left(b - c\right)"),
        ("(a + b) ** 2 / -c", r"\frac{\left(a + b\right)^{2}}{-c}"),
        ("-a / b * (-x) ** 2", r"-\frac{a}{b} \left(-x\right)^{2}"),
        ("-(a + b)", r"-\left(a + b\right)"),
        ("exp(-T / T_s) ** 2", r"\left(\mathrm{e}^{-\frac{T}{T_{s}}}\right)^{2}"),
        ("gamma_1 * 3e-05 * 10 ** x1", r"\gamma_{1} \cdot 3 \cdot 10^{-5} \cdot 10^{x_{1}}"),
        ("max(abs(v) - v_th, 0) + sign(x)", r"\max\left(\left|v\right| - v_{\mathrm{th}}, 0\right) + "
         r"\operatorname{sign}\left(x\right)"),
    ],
)  # fmt: skip
def test_latex_of_an_expression(expression: str, latex: str) -> None:
    assert latex_of(expression) == latex


def test_every_law_of_the_paper_and_every_effect_s_rate_has_balanced_brackets() -> None:
    laws = [
        law.equation for link in paper_model().link_laws.values() for law in (link.stiffness, link.damping)
    ]
    laws += [m.equation for m in CATALOGUE.values() if m.kind == "law change"]
    for text in laws:
        shown = latex_of(text)
        assert shown.count("{") == shown.count("}")
        assert shown.count(r"\left") == shown.count(r"\right")


@pytest.mark.parametrize("text", ["import os", "a if b else c", "f(v)", "a b", "'v'"])
def test_what_is_no_arithmetic_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="an expression must be arithmetic"):
        latex_of(text)
