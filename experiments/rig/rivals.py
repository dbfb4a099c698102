"""Tension laws a bolt might follow instead of Eq. 12, for studies that try to tell them apart.

Each loses at 150 N under the nominal hit what Eqs. 12-13 lose there, 6.2 N after 3 s. Elsewhere they differ:
under softer or longer hits, at other preloads, and in when after the impact the tension falls.
"""

from collections.abc import Mapping
from types import MappingProxyType

from experiments.rig.plant import LooseningTerm

RIVALS: Mapping[str, tuple[LooseningTerm, ...]] = MappingProxyType(
    {
        "power-1": (LooseningTerm(6.00, velocity_power=1.0),),
        "power-2": (LooseningTerm(8.48, velocity_power=2.0),),
        "power-3": (LooseningTerm(10.37, velocity_power=3.0),),
        "power-5": (LooseningTerm(13.10, velocity_power=5.0),),
        "constant-quartic": (LooseningTerm(6.75, 0.0),),
        "constant-quadratic": (LooseningTerm(3.46, 0.0, velocity_power=2.0),),
        "displacement-2": (LooseningTerm(12.62, velocity_power=0.0, displacement_power=2.0),),
        "displacement-4": (LooseningTerm(21.56, velocity_power=0.0, displacement_power=4.0),),
        "displacement-threshold": (
            LooseningTerm(
                3.668, 0.0, velocity_power=0.0, displacement_power=1.0, displacement_threshold=20e-6
            ),
        ),
        "path": (LooseningTerm(0.980, 0.0, velocity_power=1.0),),
        "slip-work": (LooseningTerm(0.773, 0.0, velocity_power=0.0, dissipation_power=1.0),),
        "threshold": (LooseningTerm(12.67, velocity_threshold=0.020),),
        "threshold-30": (LooseningTerm(13.22, velocity_threshold=0.030),),
        "velocity-and-displacement": (
            LooseningTerm(11.49),
            LooseningTerm(12.32, velocity_power=0.0, displacement_power=2.0),
        ),
    }
)
"""Terms by name; ``Plant(loosening=RIVALS["power-2"])`` builds the rig with one of them."""
