"""What stands on the table: two oscillators on flexures, a lap joint between them and one bolt."""

from dataclasses import dataclass, replace
from math import log10
from typing import NamedTuple, Self

from experiments.rig.undeclared import Undeclared


class Constants(NamedTuple):
    """Numbers the integrator works with for one assembly (SI units; index 0: LO, 1: SO)."""

    mass_lo: float
    mass_so: float
    damping_lo: float
    damping_so: float
    stiffness_lo: float
    stiffness_so: float
    k_i: float
    alpha: float
    beta: float
    c_d: float
    c_i: float
    eta: float


@dataclass(frozen=True)
class LooseningTerm:
    """One term of the tension law.

    ``dT/dt = -factor gamma(T) max(|v| - v_0, 0)^p max(|x| - x_0, 0)^q |D v|^r T`` with
    ``gamma(T) = 10^(gamma_d - gamma_i / (1 + exp(rho T)))`` (He et al. 2025, Eqs. 12-13: p = 4, q = r = 0).
    ``gamma_i = 0`` makes gamma constant. x, v: relative displacement [m] and velocity [m/s], LO minus SO;
    D: viscous part of the joint's force [N].
    """

    gamma_d: float = 11.79
    gamma_i: float = 7.974
    rho: float = -0.00362
    velocity_power: float = 4.0
    displacement_power: float = 0.0
    velocity_threshold: float = 0.0
    displacement_threshold: float = 0.0
    dissipation_power: float = 0.0

    def row(self, factor: float) -> tuple[float, ...]:
        """Numbers of the compiled rate function, in its order."""
        return (
            factor,
            self.gamma_d,
            self.gamma_i,
            self.rho,
            self.velocity_power,
            self.displacement_power,
            self.velocity_threshold,
            self.displacement_threshold,
            self.dissipation_power,
        )


@dataclass(frozen=True)
class Plant:
    """Physical parameters of the rig.

    Eqs. 2, 5, 11: ``k_C(T) = k_i / (1 + exp(alpha (T - beta)))``, ``c_C(T) = c_d - c_i / (1 + exp(eta T))``.

    Attributes
    ----------
    mass_lo, mass_so : float
        Masses [kg], Section 2.2.
    damping_lo, damping_so : float
        Flexure dampings [N s/m], Section 3.1. For SO the printed 2.696 is taken, a damping ratio of 0.0049;
        the printed ratio 0.004 would be 2.20 N s/m.
    stiffness_lo, stiffness_so : float
        Flexure stiffnesses without the bolt [N/m], Section 3.1.
    stiffening_lo, stiffening_so : float
        Factors on the flexure stiffnesses once the bolt is in, Section 3.2.
    loosening : tuple of LooseningTerm
        Terms of the tension law; empty for a bolt that holds.
    effects : tuple of Undeclared
        Physics beyond the paper's model, and faults of the sensors.
    """

    mass_lo: float = 8.625
    mass_so: float = 0.9888
    damping_lo: float = 8.200
    damping_so: float = 2.696
    stiffness_lo: float = 8148.7
    stiffness_so: float = 76500.0
    stiffening_lo: float = 1.10
    stiffening_so: float = 1.20
    k_i: float = 9.763e5
    alpha: float = -0.0608
    beta: float = 2.003
    c_d: float = 1853.0
    c_i: float = 1717.4
    eta: float = -0.00922
    loosening: tuple[LooseningTerm, ...] = (LooseningTerm(),)
    effects: tuple[Undeclared, ...] = ()

    def at_rate(self, factor: float) -> Self:
        """The rig whose bolt loosens so many times as fast."""
        terms = (replace(term, gamma_d=term.gamma_d + log10(factor)) for term in self.loosening)
        return replace(self, loosening=tuple(terms))

    def without_bolt(self) -> Self:
        """The same rig with the bolt taken out: no joint, no stiffening, no tension law."""
        left = tuple(effect for effect in self.effects if not effect.bolted)
        return replace(
            self, stiffening_lo=1.0, stiffening_so=1.0, k_i=0.0, c_d=0.0, c_i=0.0, loosening=(), effects=left
        )

    def constants(self) -> Constants:
        """Numbers of this assembly for the integrator, flexures stiffened."""
        return Constants(
            self.mass_lo,
            self.mass_so,
            self.damping_lo,
            self.damping_so,
            self.stiffness_lo * self.stiffening_lo,
            self.stiffness_so * self.stiffening_so,
            self.k_i,
            self.alpha,
            self.beta,
            self.c_d,
            self.c_i,
            self.eta,
        )
