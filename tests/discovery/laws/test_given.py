"""Laws of one's own: what they may be, how they are refused, and that the true one is found among them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from discovery.courses.fit import fit, resimulate
from discovery.courses.frozen_motion import freeze
from discovery.courses.prediction import predict
from discovery.laws.candidate import constant_power
from discovery.laws.given import GivenLaw, check_finite, given_law, starts_of
from discovery.laws.law_file import read_laws
from discovery.ranking.pairwise import compare_laws, not_told_apart
from discovery.ranking.race import race
from rom.model.laws import Parameter, free_form_law, logistic_stiffness
from rom.parameters.he_2025 import paper_model
from tests.discovery.synthetic import known_fit, measured

HEAD = 'format = "boltlaw-laws/1"\n'


def law_file(tmp_path: Path, *laws: str) -> Path:
    path = tmp_path / "laws.toml"
    path.write_text(HEAD + "".join(f"[[law]]\n{law}\n" for law in laws), encoding="utf-8")
    return path


def test_a_file_of_laws_is_read(tmp_path: Path) -> None:
    path = law_file(
        tmp_path,
        'name = "slip work"\nrate = "-a*abs(D*v)*max(T, 0)"\n'
        'parameters = { a = { value = 2, unit = "1/J", low = 0 } }',
        'name = "power"\nrate = "-c * abs(v / v0)**n * T"\nparameters = { c = { value = 1.0, unit = "1/s" }, '
        'v0 = { value = 0.05, unit = "m/s", fixed = true }, n = { value = 3.0, low = 0.5, high = 8.0 } }',
    )
    first, second = read_laws(path)
    assert (first.name, first.equation, first.free) == ("slip work", "-a * abs(D * v) * max(T, 0)", ("a",))
    assert first.parameters["a"].bounds == (0.0, np.inf)
    assert second.free == ("c", "n")
    assert second.coefficient_names == ("c",)  # v0 is fixed, n an exponent
    assert first.source == second.source == "given"


@pytest.mark.parametrize(
    ("rate", "parameters", "said"),
    [
        ("-a * v**4 * T", 'a = { value = 1.0, unit = "1/J" }', "expected N/s"),
        ("-a * v * T", "", "may use T, x, v, F, D, got 'a'"),
        ("-a * T", 'a = { value = 1.0, unit = "1/s" }', "while nothing moves"),
        ("-a * abs(v) * T / x", "a = { value = 1.0 }", "not a number at rest"),
        ("-a * (v + x) * T", 'a = { value = 1.0, unit = "1/m" }', "expected one unit"),
        ("-a * exp(T) * v", 'a = { value = 1.0, unit = "N/m" }', "without unit"),
        ("-a * v * T", 'a = { value = 1.0, unit = "1/km" }', "a unit must be made of"),
        ("-a * v * T", 'a = { value = 1.0, unit = "1/mm" }', "without prefix"),
        ("-a * v * T", 'a = { value = 1.0, unit = "1/m", low = 2.0 }', "from 2 to inf"),
        ("-a * v * T", 'a = { unit = "1/m" }', "found nothing, expected a number"),
        ("import os", "", "must be arithmetic"),
        ("-own_rate * v * T", 'own_rate = { value = 1.0, unit = "1/m" }', "another name"),
    ],
)
def test_a_law_that_cannot_be_is_one_clear_line(
    tmp_path: Path, rate: str, parameters: str, said: str
) -> None:
    path = law_file(tmp_path, f'name = "a"\nrate = "{rate}"\nparameters = {{ {parameters} }}')
    with pytest.raises(ValueError, match="law") as raised:
        read_laws(path)
    assert said in str(raised.value)
    assert str(raised.value).startswith(str(path))
    assert "\n" not in str(raised.value)


def test_a_misspelt_key_is_named_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match='found an unknown key, expected "rate"'):
        read_laws(law_file(tmp_path, 'name = "a"\nraet = "-a * v * T"'))


def test_names_are_their_own(tmp_path: Path) -> None:
    one = 'name = "a"\nrate = "-a * abs(v) * T"\nparameters = { a = { value = 1.0, unit = "1/m" } }'
    with pytest.raises(ValueError, match="found the name 'a' again"):
        read_laws(law_file(tmp_path, one, one))


def test_what_is_no_file_of_laws_is_told(tmp_path: Path) -> None:
    path = tmp_path / "laws.toml"
    with pytest.raises(ValueError, match="cannot be read"):
        read_laws(path)
    path.write_text("law = [", encoding="utf-8")
    with pytest.raises(ValueError, match="not TOML"):
        read_laws(path)
    path.write_text('format = "other"\n', encoding="utf-8")
    with pytest.raises(ValueError, match="boltlaw-laws/1"):
        read_laws(path)


def test_what_is_no_law_is_refused_in_a_line() -> None:
    with pytest.raises(ValueError, match=r"laws: found 3, expected an expression, a law, or a row"):
        given_law(3)  # type: ignore[arg-type]


def test_an_expression_alone_is_a_law_whose_only_number_has_the_unit_that_fits() -> None:
    law = given_law("-a*abs(D*v)*max(T, 0)")
    assert law.parameters["a"].unit == "N^-1 m^-1"
    with pytest.raises(ValueError, match="expected a tension rate"):
        given_law(logistic_stiffness(1e4, -0.01, 50.0))


def test_a_pole_within_the_motion_is_refused() -> None:
    frozen = freeze(paper_model(), measured(constant_power(4.0, "q"), length_s=0.2))
    parameters = {"a": Parameter(1e6, "s3/m4"), "T0": Parameter(300.0, "N", bounds=(0.1, 500.0))}
    law = given_law(free_form_law("pole", "-a * v**4 * T * exp(T / T0)", "tension rate", parameters))
    assert isinstance(law, GivenLaw)
    with pytest.raises(ValueError, match=r"not a number at T = .* N, x = .* with a = .*, T0 = 0.1"):
        check_finite(law, frozen.nodes)


def test_starts_lie_within_ranges_with_two_ends() -> None:
    parameters = {"c": Parameter(1.0, "1/s"), "n": Parameter(3.0, "1", bounds=(0.0, 10.0))}
    law = given_law(free_form_law("n", "-c * abs(v / 0.05)**n * T", "tension rate", parameters))
    assert [s.parameters["n"].value for s in starts_of(law)] == [3.0, 1.0, 5.0, 9.0]
    assert len({s.key for s in starts_of(law)}) == 1


def test_node_by_node_it_is_what_the_terms_are() -> None:
    terms = constant_power(4.0, "q").with_values({"gamma": 6e7})
    frozen = freeze(paper_model(), measured(terms, length_s=0.5))
    same = given_law(
        free_form_law("q", "-a * v**4 * max(T, 0)", "tension rate", {"a": Parameter(6e7, "s3/m4")})
    )
    u = np.linspace(-0.5, 0.5, len(frozen))
    loss = np.abs(predict(terms, frozen)[:, -1:])
    assert (
        np.abs(predict(same, frozen, deviations=u) - predict(terms, frozen, deviations=u)).max()
        < 0.02 * loss.max()
    )
    np.testing.assert_allclose(
        resimulate(same, frozen, u), resimulate(terms, frozen, u), rtol=1e-9, atol=1e-9
    )


def test_its_fit_is_that_of_the_same_law_by_terms_from_far_away() -> None:
    hidden = constant_power(4.0, "q").with_values({"gamma": 6e7})
    frozen = freeze(paper_model(), measured(hidden, scatter=0.2, seed=3, length_s=0.5))
    parameters = {"c": Parameter(1e-9, "1/s"), "n": Parameter(1.0, "1", bounds=(0.5, 8.0))}
    law = given_law(free_form_law("n", "-c * abs(v / 0.05)**n * max(T, 0)", "tension rate", parameters))
    found = known_fit(law, frozen)
    low, high = found.limits("n")
    assert low < 4.0 < high
    assert found.deviance < fit(hidden, frozen).deviance + 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "seeds"),
    [
        ("slip work", 3),
        *(
            pytest.param(name, 10, marks=pytest.mark.variant)
            for name in ("slip work", "quartic", "threshold")
        ),
    ],
)
def test_the_true_law_is_first_or_not_told_apart(hidden: str, seeds: int) -> None:
    """In nine seeds of ten, in each of three."""
    laws, right, held = literature(), 0, []
    for seed in range(seeds):
        courses = measured(
            laws[hidden], preloads=np.geomspace(10.0, 2000.0, 6), scatter=0.25, seed=seed, length_s=0.25
        )
        frozen = freeze(paper_model(), courses)
        ranked = race([start for law in laws.values() for start in starts_of(law)], frozen, seed=seed)
        assert sum(law.probability for law in ranked) == pytest.approx(1.0)
        fits = [replace(law.fit, candidate=law.candidate) for law in ranked]
        pairs = compare_laws(fits, frozen, {law.name: law.scores for law in ranked})
        right += hidden in (ranked[0].name, *not_told_apart(pairs, ranked[0].name))
        own = next(law for law in ranked if law.name == hidden)
        for name, parameter in own.parameters.items():
            assert parameter.low is not None
            assert parameter.high is not None
            held.append(parameter.low < laws[hidden].parameters[name].value < parameter.high)
    assert right >= 0.9 * seeds
    assert np.mean(held) >= 0.8  # of 3 to 20, for limits of 95 %


def literature() -> dict[str, GivenLaw]:
    """Laws of the literature with true numbers: power 4 and slip work; a threshold on displacement."""
    rates = {
        "quartic": ("-g * v**4 * max(T, 0)", {"g": Parameter(6e7, "s3/m4")}),
        "slip work": ("-a * abs(D * v) * max(T, 0)", {"a": Parameter(10.0, "1/J")}),
        "threshold": (
            "-b * max(abs(x) - x0, 0)**2 * max(T, 0)",
            {"b": Parameter(1e9, "m^-2 s^-1"), "x0": Parameter(2e-5, "m", bounds=(0.0, 3e-4))},
        ),
    }
    found = {n: given_law(free_form_law(n, rate, "tension rate", p)) for n, (rate, p) in rates.items()}
    return {name: law for name, law in found.items() if isinstance(law, GivenLaw)}
