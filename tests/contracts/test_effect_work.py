"""Work of every effect along closed motions: what is passive takes energy, what has no memory keeps it."""

import numpy as np
import pytest

from rom.effects import CATALOGUE, link_stiffness
from rom.effects.member import Member
from tests.contracts.effect_cases import drawn, driven, members, motion, name_of

FORCES = members("force")
PASSIVE = [member for member in FORCES if member.passive]
CONSERVATIVE = list(link_stiffness.MEMBERS)


def work(member: Member, seed: int, ground: bool = False) -> tuple[float, float]:
    """Work of the force along a closed random motion [J], and what its size would be without sign."""
    rng = np.random.default_rng(seed)
    p = list(drawn(member, rng, share=0.9, ground=ground).values())
    path = motion(rng)
    force = driven(member.function, p, len(member.state_units), path)
    power, step = force * path[2][::2], path[3]
    return float(np.trapezoid(power, dx=step)), float(np.trapezoid(abs(power), dx=step))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("member", PASSIVE, ids=name_of)
def test_a_passive_effect_takes_energy_over_a_closed_motion(member, seed):
    for ground in {False, "ground" in member.places}:
        taken, size = work(member, seed, ground)
        assert size > 0.0
        assert taken > 1e-6 * size


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("member", CONSERVATIVE, ids=name_of)
def test_a_force_without_memory_gives_back_what_it_took(member, seed):
    taken, size = work(member, seed)
    assert abs(taken) <= 1e-4 * size


@pytest.mark.parametrize("member", PASSIVE, ids=name_of)
def test_bounds_keep_a_passive_effect_from_driving(member):
    for name in member.strengths:
        assert member.parameters[name].bounds[0] == 0.0


def test_every_damping_and_friction_of_the_core_is_passive():
    from rom.effects import link_friction

    assert all(member.passive for member in link_friction.MEMBERS if member.core)
    assert not {member.name for member in CONSERVATIVE} & {member.name for member in PASSIVE}
    assert len(CATALOGUE) > len(PASSIVE) > 5
