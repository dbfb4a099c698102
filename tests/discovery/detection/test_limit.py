"""The search of a limit, with responses that are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from discovery.detection.limit import NEVER, UNSEEN, DetectionLimit, limits_of
from discovery.detection.power import Background, Response
from rom.effects import CATALOGUE, Member, ModelCorrection

NAME, PLACE = "cubic-stiffness", "flexure_lo"


@dataclass
class FakeMeter:
    """A cubic spring whose response has a square of so much at its usual strength, with some power of it."""

    square: float = 1e4
    power: float = 1.0
    linear: bool = True
    reason: str = ""
    name: str = NAME
    asked: list[float] = field(default_factory=list)
    background = Background(cost=1e3, level=1.0, gains=(150.0, 20.0))

    def pairs(self) -> Sequence[tuple[Member, ModelCorrection]]:
        member = CATALOGUE[self.name]
        return [(member, member.at(PLACE, ground=True))]

    def unavailable(self, _member: Member, _effect: ModelCorrection) -> str:
        return self.reason

    def is_linear(self, _member: Member) -> bool:
        return self.linear

    def squares(self, effects: Sequence[ModelCorrection]) -> Sequence[float]:
        return [one.square for one in self.responses(effects) if one is not None]

    def responses(self, effects: Sequence[ModelCorrection]) -> Sequence[Response | None]:
        found = []
        for effect in effects:
            strength = next(effect.parameters[n].value for n in CATALOGUE[self.name].strengths)
            usual = self.pairs()[0][1].parameters
            share = strength / next(usual[n].value for n in CATALOGUE[self.name].strengths)
            if "delta" in effect.parameters:  # a wider gap shows less
                share *= (usual["delta"].value / effect.parameters["delta"].value) ** 0.5
            self.asked.append(share)
            each = np.full(10, self.square * share ** (2 * self.power) / 10)
            found.append(Response(each, each, felt=100 * share))
        return found


def only(meter: FakeMeter) -> DetectionLimit:
    (limit,) = limits_of(meter)
    return limit


def test_a_limit_has_its_share_of_the_usual_strength_and_what_is_felt() -> None:
    limit = only(FakeMeter())
    usual = CATALOGUE[NAME].at(PLACE, ground=True).parameters["k3"]
    assert (limit.name, limit.enters, limit.parameter, limit.unit) == (NAME, PLACE, "k3", "N/m3")
    assert limit.share_of_default == pytest.approx(0.131, rel=0.05)  # sqrt(150) + 0.84 is 13.1 of 100
    assert limit.value == pytest.approx(limit.share_of_default * usual.value)
    assert limit.felt_percent == pytest.approx(100 * limit.share_of_default)
    assert limit.worst_value == limit.value
    assert limit.reason == ""


def test_a_response_out_of_proportion_is_followed_to_the_limit() -> None:
    meter = FakeMeter(power=2.0, linear=False)
    limit = only(meter)
    assert limit.share_of_default == pytest.approx(0.131**0.5, rel=0.05)
    assert 2 <= len(meter.asked) <= 5
    assert only(FakeMeter(power=2.0)).share_of_default != pytest.approx(0.131**0.5, rel=0.05)


@pytest.mark.parametrize(
    ("meter", "reason"),
    [(FakeMeter(square=1e-3), NEVER), (FakeMeter(square=0.0), UNSEEN), (FakeMeter(reason="mains"), "mains")],
)
def test_what_has_no_limit_says_why(meter: FakeMeter, reason: str) -> None:
    limit = only(meter)
    assert (limit.value, limit.felt_percent, limit.share_of_default, limit.worst_value) == (None,) * 4
    assert limit.reason == reason


def test_the_worst_shape_has_a_higher_limit() -> None:
    limit = only(FakeMeter(name="two-sided-gap"))
    widest = (
        max(CATALOGUE["two-sided-gap"].inner["delta"]) / CATALOGUE["two-sided-gap"].parameters["delta"].value
    )
    assert limit.value is not None
    assert limit.worst_value == pytest.approx(limit.value * widest**0.5, rel=0.02)


def test_a_limit_tells_the_shape_it_is_of_and_a_slider_slips_where_it_did() -> None:
    limit, usual = (
        only(FakeMeter(name="jenkins-slip")),
        CATALOGUE["jenkins-slip"].at(PLACE, ground=True).parameters,
    )
    assert limit.value is not None
    assert limit.shape["F_s"] / limit.value == pytest.approx(usual["F_s"].value / usual["kappa"].value)
    assert set(limit.shape) == {"F_s", "mu"}
    assert only(FakeMeter()).shape == {}


def test_a_limit_that_has_not_settled_is_a_strength_that_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """What turns up all at once has no limit between responses; the least that is known to show is told."""

    class Sudden(FakeMeter):
        def responses(self, effects: Sequence[ModelCorrection]) -> Sequence[Response | None]:
            found = super().responses(effects)
            shares = self.asked[-len(effects) :]
            return [
                one and replace(one, training=one.training * (1.0 if share > 0.0731 else 1e-9))
                for one, share in zip(found, shares, strict=True)
            ]

    monkeypatch.setattr("discovery.detection.limit._ROUNDS", 4)
    meter = Sudden(square=1e6, linear=False)
    limit = only(meter)
    assert limit.share_of_default is not None
    assert limit.share_of_default > 0.0731
    assert min(abs(np.log(share / limit.share_of_default)) for share in meter.asked) < 0.05
