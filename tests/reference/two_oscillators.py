"""The paper's model on one page, in plain SciPy: He et al. (2025), Eqs. 2, 5, 11, 12 and 13.

Slow and without structure on purpose: the modular model is held to it.
"""

import numpy as np
from scipy.integrate import solve_ivp

M_LO, M_SO = 8.625, 0.9888
K_LO, K_SO = 8963.6, 91800.0
C_LO, C_SO = 8.200, 2.696


def k_c(T):
    return 9.763e5 / (1 + np.exp(-0.0608 * (T - 2.003)))


def c_c(T):
    return 1853.0 - 1717.4 / (1 + np.exp(-0.00922 * T))


def gamma(T):
    return 10 ** (11.79 - 7.974 / (1 + np.exp(-0.00362 * T)))


def derivative(t, y, start, force, slope):
    x_lo, x_so, v_lo, v_so, T = y
    x, v = x_lo - x_so, v_lo - v_so
    joint = k_c(T) * x + c_c(T) * v
    return [
        v_lo,
        v_so,
        (force + slope * (t - start) - C_LO * v_lo - K_LO * x_lo - joint) / M_LO,
        (-C_SO * v_so - K_SO * x_so + joint) / M_SO,
        -gamma(T) * v**4 * T,
    ]


def simulate(force, rate_hz, initial_tension, rtol=1e-12):
    """States at the force's samples, shape (5, samples): DOP853 from knot to knot of the linear force."""
    states = np.zeros((5, len(force)))
    states[4, 0] = initial_tension
    for i in range(len(force) - 1):
        slope = (force[i + 1] - force[i]) * rate_hz
        span = (i / rate_hz, (i + 1) / rate_hz)
        solution = solve_ivp(
            derivative, span, states[:, i], "DOP853", args=(span[0], force[i], slope), rtol=rtol, atol=1e-18
        )
        states[:, i + 1] = solution.y[:, -1]
    return states
