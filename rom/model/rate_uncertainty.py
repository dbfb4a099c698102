"""How far the loosening of one new test may be from what a model's tension law says."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
_REFERENCE_N = 100.0


@dataclass(frozen=True)
class RateUncertainty:
    """Covariance of a tension law's numbers, and how its rate differs from test to test.

    ``tau(T) = at_100_n (T / 100 N)^slope`` is the standard deviation of the natural logarithm of the rate
    from one test to the next.

    Parameters
    ----------
    parameters : tuple of str
        Numbers that were fitted: of the law by their names, of its changes by their paths in the model.
    covariance : tuple of tuple of float, shape (parameters, parameters)
        Of their values.
    at_100_n, slope : float
        Between-test standard deviation of ln rate at 100 N, and its power of the tension.
    degrees_of_freedom : int
        Tests less numbers fitted to them.
    between_bolts : float
        Standard deviation of ln rate from one bolt of a kind to the next; 0 for the bolt that was fitted.

    Raises
    ------
    ValueError
        If a parameter is no name, the covariance is not square over them or not finite, or the deviation
        is not a number from 0 up.
    """

    parameters: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
    at_100_n: float
    slope: float = 0.0
    degrees_of_freedom: int = 1
    between_bolts: float = 0.0

    def __post_init__(self) -> None:
        if not all(isinstance(name, str) for name in self.parameters):
            raise ValueError(f"parameters must be names, got {self.parameters}")
        count, lengths = len(self.parameters), [len(row) for row in self.covariance]
        if lengths != [count] * count:
            raise ValueError(f"covariance must have {count} rows of {count} numbers, got {lengths}")
        if not np.isfinite(np.array(self.covariance)).all():
            raise ValueError(f"covariance must hold finite numbers, got {self.covariance}")
        if not (self.at_100_n >= 0 and np.isfinite([self.at_100_n, self.slope]).all()):
            raise ValueError(
                f"between-test deviation must be a number from 0 up, got {self.at_100_n}, {self.slope}"
            )

    @classmethod
    def of(
        cls,
        parameters: Sequence[str],
        covariance: npt.ArrayLike,
        between_tests: tuple[float, float],
        degrees_of_freedom: int,
        between_bolts: float = 0.0,
    ) -> RateUncertainty:
        """From arrays.

        Parameters
        ----------
        parameters : sequence of str
            Numbers of the law that were fitted.
        covariance : array, shape (parameters, parameters)
            Of their values.
        between_tests : tuple of float
            Between-test standard deviation of ln rate at 100 N, and its power of the tension.
        degrees_of_freedom : int
            Tests less numbers; one at least is taken.
        between_bolts : float
            Between-bolt standard deviation of ln rate.
        """
        rows = np.asarray(covariance, dtype=np.float64).reshape((len(parameters),) * 2)
        return cls(
            tuple(parameters), tuple(map(tuple, rows.tolist())), float(between_tests[0]),
            float(between_tests[1]), max(int(degrees_of_freedom), 1), float(between_bolts),
        )  # fmt: skip

    def of_a_test(self, tension: float) -> float:
        """Return the standard deviation of ln rate of a new test at a tension [N], tau and bolt together."""
        tau = self.at_100_n * math.pow(max(tension, 1e-3) / _REFERENCE_N, self.slope)
        return math.hypot(tau, self.between_bolts)

    def as_data(self) -> dict[str, Any]:
        """Return the entry of ``model.json``."""
        return {
            "parameters": list(self.parameters),
            "covariance": [list(row) for row in self.covariance],
            "between_tests": {"at_100_n": self.at_100_n, "slope": self.slope},
            "between_bolts": self.between_bolts,
            "degrees_of_freedom": self.degrees_of_freedom,
        }

    @classmethod
    def from_data(cls, data: Mapping[str, Any] | None) -> RateUncertainty | None:
        """Return what an entry of ``model.json`` says; None where there is none."""
        if data is None:
            return None
        spread = data["between_tests"]
        return cls.of(
            data["parameters"], data["covariance"], (spread["at_100_n"], spread["slope"]),
            data["degrees_of_freedom"], data.get("between_bolts", 0.0),
        )  # fmt: skip
