"""Changes of the law of a bolt's tension: what else loosens or tightens it, and when it does so at all.

Each is its own text (see ``LawChange``): ``rate`` is the rate of the law that is changed, ``follow`` its
dependence on tension. Powers of the motion are taken relative to 0.1 mm and 50 mm/s.
"""

from __future__ import annotations

from rom.effects.member import Member, parameter

_FOLLOW = parameter(1.0, "1", 0.0, 1.5)

MEMBERS = (
    Member(
        "loosening-displacement",
        ("tension",),
        "rate - g_x * max(T, 0) * follow ** h_x * (abs(x) / 1e-4) ** p_x",
        {"g_x": parameter(0.1, "1/s", 0.0, 50.0), "p_x": parameter(2.0, "1", 1.0, 4.0), "h_x": _FOLLOW},
        {"g_x": 0.01},
        ("loosening by displacement",),
        "Rousseau and Bouzid, Materials 18, 462 (2025)",
        inner={"p_x": (1.0, 2.0, 4.0), "h_x": (0.0, 1.0)},
    ),
    Member(
        "loosening-dissipation",
        ("tension",),
        "rate - g_e * max(T, 0) * follow ** h_e * abs(D * v)",
        {"g_e": parameter(5.0, "1/J", 0.0, 2e3), "h_e": _FOLLOW},
        {"g_e": 0.5},
        ("loosening by dissipation",),
        "Orclever EJRND 693: energy balance of loosening",
        inner={"h_e": (0.0, 1.0)},
    ),
    Member(
        "loosening-threshold",
        ("tension",),
        "rate * max(1 - v_th / max(abs(v), 1e-9), 0) ** 4",
        {"v_th": parameter(0.025, "m/s", 0.0, 0.1)},
        {"v_th": 0.01},
        ("loosening onset",),
        "Izumi et al., Engineering Failure Analysis 12, 604 (2005); Nassar and Yang, JVA 131, 021009 (2009)",
        linear=False,
    ),
    Member(
        "loosening-power",
        ("tension",),
        "rate * (max(abs(v), 1e-9) / 0.05) ** q_v",
        {"q_v": parameter(-1.0, "1", -3.0, 3.0)},
        {"q_v": 0.3},
        ("loosening onset", "loosening by dissipation"),
        "He et al. (2025), Eq. 12 with another power",
        linear=False,
    ),
    Member(
        "loosening-slip-gate",
        ("tension",),
        "rate * ((abs(F) ** 8 + 1e-99) / (abs(F) ** 8 + (mu_t * max(T, 0)) ** 8 + 1e-99))",
        {"mu_t": parameter(0.12, "1", 0.0, 0.5)},
        {"mu_t": 0.05},
        ("loosening onset",),
        "Pai and Hess, JSV 253, 585 (2002)",
        linear=False,
    ),
    Member(
        "tightening",
        ("tension",),
        "rate + g_t * max(T, 0) * follow ** h_t * (abs(v) / 0.05) ** q_t",
        {"g_t": parameter(10.0, "1/s", 0.0, 300.0), "q_t": parameter(3.0, "1", 2.0, 4.0), "h_t": _FOLLOW},
        {"g_t": 1.0},
        ("net tightening",),
        "He et al. (2025), section 3.4; Dynamic loosening and tightening, JVA 119, 311 (1997)",
        inner={"q_t": (2.0, 3.0, 4.0), "h_t": (0.0, 1.0)},
    ),
    Member(
        "loosening-ratchet",
        ("tension",),
        "rate - r * abs(v) * max(T, 0) * follow ** h_r * max(1 - x_r / max(abs(x), 1e-12), 0)",
        {
            "r": parameter(1.7, "1/m", 0.0, 200.0),
            "x_r": parameter(0.0, "m", 0.0, 1e-4),
            "h_r": _FOLLOW,
        },
        {"r": 0.05},
        ("loosening by slip",),
        "Pai and Hess, JSV 253, 585 (2002): loosening per path of slip",
        inner={"x_r": (0.0, 2e-5), "h_r": (0.0, 1.0)},
    ),
)
