# ruff: noqa: ARG001 - every change has the arguments of its place
"""Undeclared changes of the tension law.

Each is ``f(rate, T, x, v, a, F, D, follow, p) -> rate [N/s]``: from the rate of the law so far to another. T:
tension [N]; x, v, a: relative displacement [m], velocity [m/s], acceleration [m/s2] of the joint; F, D: its
force and the viscous part of it [N]; follow: the paper's gamma(T) over its value at 100 N.
"""

from collections.abc import MutableSequence

from experiments.rig.kinds import Family, Kind, Number, constant

Array = MutableSequence[float]
TENSION: tuple[Family, ...] = ("tension",)


def _shift(
    rate: float, T: float, x: float, v: float, a: float, F: float, D: float, follow: float, p: Array
) -> float:
    change: float = p[0] * T * follow ** p[2] * (abs(x) / 1e-4) ** p[1]
    return rate - change


def _dissipation(
    rate: float, T: float, x: float, v: float, a: float, F: float, D: float, follow: float, p: Array
) -> float:
    change: float = p[0] * T * follow ** p[1] * abs(D * v)
    return rate - change


def _threshold(
    rate: float, T: float, x: float, v: float, a: float, F: float, D: float, follow: float, p: Array
) -> float:
    return rate * (1.0 - p[0] / abs(v)) ** 4 if abs(v) > p[0] else 0.0


def _power(
    rate: float, T: float, x: float, v: float, a: float, F: float, D: float, follow: float, p: Array
) -> float:
    factor: float = (max(abs(v), 1e-9) / 0.05) ** p[0]
    return rate * factor


def _slip_gate(
    rate: float, T: float, x: float, v: float, a: float, F: float, D: float, follow: float, p: Array
) -> float:
    return rate if abs(F) >= p[0] * T else 0.0


def _tightening(
    rate: float, T: float, x: float, v: float, a: float, F: float, D: float, follow: float, p: Array
) -> float:
    change: float = p[0] * T * follow ** p[2] * (abs(v) / 0.05) ** p[1]
    return rate + change


def _ratchet(
    rate: float, T: float, x: float, v: float, a: float, F: float, D: float, follow: float, p: Array
) -> float:
    slip = max(1.0 - p[1] / abs(x), 0.0) if x != 0.0 else 0.0
    change: float = p[0] * T * follow ** p[2] * abs(v) * slip
    return rate - change


def _acceleration(
    rate: float, T: float, x: float, v: float, a: float, F: float, D: float, follow: float, p: Array
) -> float:
    change: float = p[0] * T * follow * (abs(a) / 50.0) ** p[1]
    return rate - change


def _action(
    rate: float, T: float, x: float, v: float, a: float, F: float, D: float, follow: float, p: Array
) -> float:
    change: float = p[0] * T * follow * (abs(x * v) / 5e-6) ** p[1]
    return rate - change


_FOLLOW = Number(1.0, "1", 0.0, 1.0)

KINDS = (
    Kind(
        "loosening-displacement", TENSION, "tension", "rate - g_x T follow^h_x (abs(x) / 0.1 mm)^p_x",
        {"g_x": Number(0.1, "1/s", 0.0, 5.0), "p_x": Number(2.0, "1", 1.0, 4.0), "h_x": _FOLLOW},
        ("g_x",), _shift, "rate",
    ),
    Kind(
        "loosening-dissipation", TENSION, "tension", "rate - g_e T follow^h_e abs(D v)",
        {"g_e": Number(5.0, "1/J", 0.0, 500.0), "h_e": _FOLLOW}, ("g_e",), _dissipation, "rate",
    ),
    Kind(
        "loosening-threshold", TENSION, "tension", "rate max(1 - v_th / abs(v), 0)^4",
        {"v_th": Number(0.025, "m/s", 0.0, 0.06)}, ("v_th",), _threshold, "rate",
    ),
    Kind(
        "loosening-power", TENSION, "tension", "rate (abs(v) / 50 mm/s)^q_v",
        {"q_v": Number(-1.0, "1", -3.0, 2.0)}, ("q_v",), _power, "rate",
    ),
    Kind(
        "loosening-slip-gate", TENSION, "tension", "rate where abs(F) >= mu_t T",
        {"mu_t": Number(0.12, "1", 0.0, 0.25)}, ("mu_t",), _slip_gate, "rate",
    ),
    Kind(
        "tightening", TENSION, "tension", "rate + g_t T follow^h_t (abs(v) / 50 mm/s)^q_t",
        {"g_t": Number(10.0, "1/s", 0.0, 100.0), "q_t": Number(3.0, "1", 2.0, 4.0), "h_t": _FOLLOW},
        ("g_t",), _tightening, "rate",
    ),
    Kind(
        "loosening-ratchet", TENSION, "tension", "rate - r T follow^h_r abs(v) max(1 - x_r / abs(x), 0)",
        {"r": Number(1.7, "1/m", 0.0, 60.0), "x_r": constant(0.0, "m"), "h_r": _FOLLOW},
        ("r",), _ratchet, "rate",
    ),
    Kind(
        "outside-loosening-by-acceleration", TENSION, "tension", "rate - g_a T follow (abs(a) / 50 m/s2)^n_a",
        {"g_a": Number(0.5, "1/s", 0.0, 50.0), "n_a": Number(1.5, "1", 1.0, 2.0)},
        ("g_a",), _acceleration, "rate",
    ),
    Kind(
        "outside-loosening-by-action", TENSION, "tension", "rate - g_s T follow (abs(x v) / 5 mm2/s)^n_s",
        {"g_s": Number(1.0, "1/s", 0.0, 100.0), "n_s": Number(1.5, "1", 1.0, 2.0)},
        ("g_s",), _action, "rate",
        nearest={"tension": "loosening-dissipation"},
    ),
)  # fmt: skip
