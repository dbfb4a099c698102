"""Stiffness and damping of a joint as a power of its tension, for tensions near to each other."""

from __future__ import annotations

import math

from rom.model.laws import Law, Parameter, Place, free_form_law


def power_stiffness(k_r: float, m: float, reference: float) -> Law:
    """``k_r (max(T, T_r / 100) / T_r)^m`` [N/m]: what contacts follow over a range of tensions.

    Parameters
    ----------
    k_r : float
        Stiffness at the reference tension [N/m].
    m : float
        Exponent [1].
    reference : float
        The tension T_r [N]; it is no free number.
    """
    return _power("power stiffness", "stiffness", ("k_r", k_r, "N/m"), m, reference)


def power_damping(c_r: float, m: float, reference: float) -> Law:
    """``c_r (max(T, T_r / 100) / T_r)^m`` [N s/m].

    Parameters
    ----------
    c_r : float
        Damping at the reference tension [N s/m].
    m : float
        Exponent [1]; negative for damping that falls with tension.
    reference : float
        The tension T_r [N]; it is no free number.
    """
    return _power("power damping", "damping", ("c_r", c_r, "N s/m"), m, reference)


def _power(name: str, enters: Place, scale: tuple[str, float, str], m: float, reference: float) -> Law:
    """Return the law; below a hundredth of the reference it is level, so that a loose bolt has a joint."""
    symbol, value, unit = scale
    parameters = {
        symbol: Parameter(value, unit, bounds=(0.0, math.inf)),
        "m": Parameter(m, "1"),
        "T_r": Parameter(reference, "N", bounds=(reference, reference), source="assumed"),
    }
    return free_form_law(name, f"{symbol} * (max(T, 0.01 * T_r) / T_r) ** m", enters, parameters)
