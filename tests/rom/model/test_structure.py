import numpy as np
import pytest

from rom.model.structure import Body, Link, Structure


def two_oscillators() -> Structure:
    return Structure(
        (Body("lo", 8.625), Body("so", 0.9888)),
        (Link("flexure", "lo", "ground"), Link("other", "ground", "so"), Link("joint", "lo", "so", "bolted")),
    )


def test_matrices_follow_the_links():
    structure = two_oscillators()
    assert np.array_equal(structure.incidence, [[1, 0], [0, -1], [1, -1]])
    assert np.array_equal(structure.ends, [[0, -1], [-1, 1], [0, 1]])
    assert np.array_equal(structure.mass_matrix, np.diag([8.625, 0.9888]))
    assert structure.bolted_links == ("joint",)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Body("lo", -1.0), "positive number of kg, got -1.0"),
        (lambda: Body("lo", float("nan")), "positive number of kg"),
        (lambda: Body("ground", 1.0), "not 'ground'"),
        (lambda: Link("joint", "lo", "lo"), "two different bodies"),
        (lambda: Link("joint", "lo", "so", "glued"), "law must be one of"),  # type: ignore[arg-type]
        (lambda: Structure((), ()), "at least one body"),
        (lambda: Structure((Body("a", 1.0), Body("a", 1.0)), ()), "unique, got a"),
        (
            lambda: Structure((Body("a", 1.0),), (Link("l", "a", "b"),)),
            "must end at one of a, ground, got 'b'",
        ),
    ],
)
def test_what_cannot_be_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
