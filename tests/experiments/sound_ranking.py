"""A ranking as `boltlaw discover` writes it, made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from rom.evaluation.error_measures import Errors

TIME_S = [0.0015, 0.0045, 0.009, 0.018, 0.04, 0.1, 0.2, 0.4, 0.8, 1.5, 3.0, 6.0]
BASELINE = "gamma(T) baseline"
WINNER = "|v|^p T exp(-T/T_s)"
SOURCES = "pysindy:powers/STLSQ"


def errors(loss: float, records: int) -> Errors:
    return {
        "motion_nrmse": 0.012,
        "relative_motion_nrmse": 0.02,
        "final_tension_error_percent_mean": 3.0,
        "final_tension_error_percent_median": 1.0,
        "final_tension_error_percent_max": 60.0,
        "tension_loss_error_percent_median": loss if records else None,
        "link_force_nrmse": None,
        "tension_rmse_n": 0.3,
        "tension_course_within_band": 0.93 if records else None,
        "records": records,
        "failed": 0,
    }


def parameter(value: float, unit: str, share: float = 0.1) -> dict[str, Any]:
    return {"value": value, "low": value * (1 - share), "high": value * (1 + share), "unit": unit}


def law(rank: int, name: str, equation: str, loss: float, bic: float, **other: Any) -> dict[str, Any]:
    return {
        "rank": rank,
        "name": name,
        "equation": equation,
        "parameters": {},
        "errors": {"training": errors(loss, 46), "hold_out": errors(1.1 * loss, 12)},
        "cross_validated_loss_error_percent_median": 1.05 * loss,
        "cross_validated_score": -10.0 - bic,
        "delta_bic": bic,
        "wins_against_baseline": [30, 58],
        "p_value_against_baseline": 0.3,
        "source": SOURCES,
        "free_numbers": 3,
    } | other


def laws() -> list[dict[str, Any]]:
    tail = "max(T, 0) * exp(-max(T, 0) / T_s)"
    won = {"gamma": parameter(6.1e4, "m^-4 s^3"), "p": parameter(4.02, "1", 0.03)}
    won |= {"T_s": parameter(312.0, "N")}
    return [
        law(1, WINNER, f"-gamma * abs(v) ** p * {tail}", 12.0, 0.0, parameters=won,
            wins_against_baseline=[44, 58], p_value_against_baseline=0.0004),
        law(2, "|D v|^n T exp(-T/T_s)", f"-gamma * abs(D * v) ** n * {tail}", 12.4, 1.7),
        law(3, BASELINE, "-gamma * abs(v) ** p * max(T, 0) * 10 ** (-gamma_i / (1 + exp(rho * max(T, 0))))",
            19.0, 38.0, source="baseline", wins_against_baseline=[0, 58], p_value_against_baseline=None),
        law(4, "|v|^p T + |x|^q T^r", "-gamma_1 * abs(v) ** p_1 * max(T, 0) - gamma_2 * abs(x) ** q_2 * "
            "max(T, 0) ** r_2", 25.0, 77.0, free_numbers=6),
        law(5, "constant gamma, quartic", "-gamma * abs(v) ** p * max(T, 0)", 60.0, 800.0, source="baseline",
            free_numbers=1),
        law(6, "constant gamma, quadratic", "-gamma * abs(v) ** p * max(T, 0)", 70.0, 1400.0,
            source="baseline", free_numbers=1),
        law(7, "no loosening", "0", 100.0, 12000.0, source="baseline", free_numbers=0),
    ]  # fmt: skip


def cases() -> list[dict[str, Any]]:
    rng = np.random.default_rng(5)
    time = np.array(TIME_S)
    made = []
    for place, initial in enumerate(np.geomspace(6.0, 3000.0, 20)):
        loss = min(0.3 * initial, 2000.0 / initial)
        for strength in (1.0, 0.8, 0.6):
            course = -loss * strength**4 * (1 - np.exp(-time / (0.002 + 5e-5 * initial)))
            noise = 0.02 * np.sqrt(1 + time)
            near = {WINNER: 1.05, "|D v|^n T exp(-T/T_s)": 1.1, BASELINE: 1.3}
            made.append(
                {
                    "file": f"records/loosening_{place:03d}_{strength:g}.h5",
                    "hold_out": place % 5 == 2,
                    "initial_tension_n": float(initial),
                    "peak_force_n": 1608.7 * strength,
                    "time_s": TIME_S,
                    "change_n": list(course + noise * rng.standard_normal(len(time))),
                    "change_error_n": list(noise),
                    "laws": {name: list(factor * course) for name, factor in near.items()},
                    "loss_error_percent": {
                        name: float(abs(100 * (factor * np.exp(0.3 * rng.standard_normal()) - 1)))
                        for name, factor in near.items()
                    },
                }
            )
    return made


def ranking() -> dict[str, Any]:
    power = np.arange(1.0, 7.01, 0.25)
    share = np.linspace(0.0, 4.0, 9)
    profile = {
        "values": list(power),
        "delta_bic": list(120 * (power - 4.02) ** 2 / (1 + 0.1 * power)),
        "best": 4.02, "low": 3.8, "high": 4.25, "reach": "identified", "level": 3.84,
    }  # fmt: skip
    displacement = {
        "values": list(share), "delta_bic": list(30 * share**1.5), "best": 0.05, "low": 0.0, "high": 0.21,
        "reach": "open below", "level": 3.84,
    }  # fmt: skip
    return {
        "format": "boltlaw-ranking/1",
        "campaign": "made by hand",
        "program_version": "0.1.0",
        "seed": 0,
        "elapsed_s": 100.0,
        "laws": laws(),
        "exponent_profile": profile,
        "motion_profile": {"driver": "velocity", "displacement": displacement, "velocity": profile},
        "indistinguishable": ["|D v|^n T exp(-T/T_s)"],
        "proposals": [
            {"body": "lo", "peak_force_n": 400.0, "pulse_s": 0.0021, "preload_n": 150.0, "hits": 3,
             "expected_gain": 2.2, "odds": 27.0, "separates": [WINNER, "|D v|^n T exp(-T/T_s)"]},
            {"body": "lo", "peak_force_n": 1608.7, "pulse_s": 0.0004, "preload_n": 800.0, "hits": 1,
             "expected_gain": 6.1, "odds": 570.0, "separates": [WINNER, "|D v|^n T exp(-T/T_s)"]},
        ],
        "chosen_terms": {"|v|^p T exp(-T/T_s)": 0.9, "|F|^m T": 0.1},
        "inclusion": {"|v|^p T exp(-T/T_s)": 0.86, "|D v|^n T exp(-T/T_s)": 0.4, "|x|^q T": 0.06},
        "considered": 2310,
        "cases": cases(),
        "set_aside": ["records/loosening_007.h5: clipped force"],
        "warnings": [],
    }  # fmt: skip
