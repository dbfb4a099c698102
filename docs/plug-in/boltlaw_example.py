"""An effect and a tension law of one's own, as an installed package adds them to boltlaw."""

from rom.effects import Member
from rom.effects.member import parameter
from rom.model.laws import Parameter, free_form_law


def _seal(t, x, v, T, k, c, s, p, ds, dT):  # noqa: ARG001 - every effect's function takes these
    return p[0] * v * x * x / (x * x + p[1] * p[1])


EFFECTS = (
    Member(
        name="seal-drag",
        places=("ground",),
        equation="F = c_s * v * x * x / (x * x + x_s * x_s)",
        parameters={"c_s": parameter(20.0, "N s/m", 0.0, 200.0), "x_s": parameter(5e-4, "m", 1e-5, 5e-3)},
        strengths={"c_s": 2.0},
        classes=("amplitude-dependent damping",),
        source="a rubber seal that touches beyond a small stroke",
        function=_seal,
        inner={"x_s": (1e-4, 5e-4, 2e-3)},
        passive=True,
    ),
)
LAWS = [
    free_form_law(
        "slip work, example",
        "-a * abs(D * v) * max(T, 0)",
        "tension rate",
        {"a": Parameter(1.0, "1/J", bounds=(0.0, float("inf")))},
    ),
]
