"""Sparse fits by pysindy's optimizers: which columns each selects along a path of thresholds.

`OPTIMIZERS` names them; an entry that is added takes part in every search.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from discovery.criteria.criteria import CRITERIA
from discovery.criteria.search import Search
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_LONG: Numerical[int] = 300  # iterations of SR3
_EXACT: Numerical[float] = 1e-10  # of the bounded fits, whose own default stops among near-equal columns


@dataclass(frozen=True, eq=False)
class SparseProblem:
    """What a sparse fit solves: ``target = theta c`` with few coefficients that are not zero.

    Attributes
    ----------
    theta : ndarray, shape (rows, columns)
        Whitened columns of length 1.
    target : ndarray, shape (rows,)
        Whitened losses, of length 1.
    rng : numpy.random.Generator
        Source of the rows of an ensemble.
    signed : bool
        Whether coefficients may have either sign.
    rules : Search
        Thresholds, ridge and largest support.
    """

    theta: FloatArray
    target: FloatArray
    rng: np.random.Generator
    signed: bool = False
    rules: Search = CRITERIA.search

    @property
    def columns(self) -> int:
        """How many columns there are."""
        return int(self.theta.shape[1])

    @property
    def thresholds(self) -> FloatArray:
        """Thresholds up to the largest coefficient: those of near-equal columns are large and cancel."""
        theta, rules = self.theta, self.rules
        normal = theta.T @ theta + rules.ridge * np.eye(self.columns)
        largest = float(np.abs(np.linalg.solve(normal, theta.T @ self.target)).max())
        least = rules.least_threshold
        return np.geomspace(least, max(largest, 2 * least), int(rules.thresholds))

    def coefficients(self, optimizer: Any) -> list[FloatArray]:
        """Coefficients of one fit; none where the optimizer warns of an empty or unconverged fit."""
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                return [np.asarray(optimizer.fit(self.theta, self.target).coef_)[0]]
            except UserWarning:
                return []

    def history(self, optimizer: Any) -> list[FloatArray]:
        """Coefficients after every step of one fit."""
        return [np.asarray(row)[0] for row in optimizer.fit(self.theta, self.target).history_]


def frols(problem: SparseProblem) -> list[FloatArray]:
    """Forward regression; its stop is unreliable and the whole path is taken."""
    from pysindy import FROLS

    count = min(int(problem.rules.largest_support) + 1, problem.columns)
    return problem.history(FROLS(max_iter=count, alpha=problem.rules.ridge)) if problem.columns > 1 else []


def ssr(problem: SparseProblem) -> list[FloatArray]:
    """Backward elimination; its stop is a guess and the whole path is taken."""
    from pysindy import SSR

    optimizer = SSR(max_iter=problem.columns, alpha=problem.rules.ridge)
    return problem.history(optimizer) if problem.columns > 1 else []


def _stlsq(problem: SparseProblem, threshold: float) -> Any:
    from pysindy import STLSQ

    return STLSQ(threshold=threshold, alpha=problem.rules.ridge, max_iter=problem.columns + 1)


def stlsq(problem: SparseProblem) -> list[FloatArray]:
    """Least squares with a threshold, repeated."""
    return [c for t in problem.thresholds for c in problem.coefficients(_stlsq(problem, t))]


def non_negative_stlsq(problem: SparseProblem) -> list[FloatArray]:
    """The same with coefficients that are not negative; empty where either sign is sought."""
    from pysindy import STLSQ

    rules = problem.rules
    if problem.signed:
        return []
    path = np.geomspace(rules.least_positive, rules.largest_share, int(rules.thresholds))
    # its last step, plain least squares on what remains, would lose the signs again
    options = {
        "alpha": rules.ridge,
        "max_iter": problem.columns + 1,
        "ridge_kw": {"positive": True, "tol": _EXACT},
        "unbias": False,
    }
    return [c for t in path for c in problem.coefficients(STLSQ(t, **options))]


def sr3(problem: SparseProblem) -> list[FloatArray]:
    """Sparse relaxed regularised regression, from zero: least squares of near-equal columns are far off."""
    from pysindy import SR3

    rules, start = problem.rules, np.zeros((1, problem.columns))
    path = np.geomspace(rules.least_threshold, rules.largest_share, int(rules.sr3_thresholds))
    return [
        c
        for share in path
        for c in problem.coefficients(
            SR3(SR3.calculate_l0_weight(share, 1.0), initial_guess=start, max_iter=_LONG, unbias=True)
        )
    ]


def ensemble(problem: SparseProblem) -> list[FloatArray]:
    """Means of many fits with a threshold, each to rows drawn again."""
    from pysindy import EnsembleOptimizer

    path, fits = problem.thresholds, int(problem.rules.ensemble)
    with _global_seed(problem.rng):
        return [
            c
            for t in path[len(path) // 2 :: 2]
            for c in problem.coefficients(EnsembleOptimizer(_stlsq(problem, t), bagging=True, n_models=fits))
        ]


Path = Callable[[SparseProblem], list[FloatArray]]

OPTIMIZERS: dict[str, Path] = {
    "FROLS": frols,
    "SSR": ssr,
    "STLSQ": stlsq,
    "non-negative STLSQ": non_negative_stlsq,
    "SR3": sr3,
    "EnsembleOptimizer": ensemble,
}
"""Name -> function from a problem to the coefficients along its path, each of shape (columns,)."""


def path_of(optimizer: Any) -> Path:
    """Return the path of an optimizer of one's own.

    It is copied, then fitted as ``fit(theta, target)`` to columns and a target of length 1: a threshold is a
    share of the target. Its result is ``coef_``, and of pysindy's FROLS and SSR, whose stop is a guess, every
    step.

    Raises
    ------
    ValueError
        When its coefficients are not one finite number a column.
    """

    def path(problem: SparseProblem) -> list[FloatArray]:
        from pysindy import FROLS, SSR

        with _global_seed(problem.rng):
            fitted = copy.deepcopy(optimizer)
            fitted.fit(problem.theta, problem.target)
        greedy = isinstance(fitted, FROLS | SSR)
        rows = [
            np.asarray(row, dtype=float).reshape(-1)
            for row in (fitted.history_ if greedy else [getattr(fitted, "coef_", np.nan)])
        ]
        for row in rows:
            if row.shape != (problem.columns,) or not np.isfinite(row).all():
                raise ValueError(
                    f"optimizer {type(optimizer).__name__}: found coef_ of shape {row.shape}, expected one "
                    f"finite number for each of {problem.columns} columns"
                )
        return rows

    return path


def sparse_supports(
    theta: FloatArray,
    target: FloatArray,
    rng: np.random.Generator,
    signed: bool = False,
    rules: Search = CRITERIA.search,
    optimizers: Mapping[str, Path] | None = None,
) -> dict[frozenset[int], tuple[str, ...]]:
    """Distinct supports on the paths of optimizers, each with the optimizers that found it.

    Parameters
    ----------
    theta : ndarray, shape (rows, columns)
        Whitened columns, none of them zero or twice there.
    target : ndarray, shape (rows,)
        Whitened losses.
    rng : numpy.random.Generator
        Source of the ensemble's rows.
    signed : bool
        Whether terms of either sign are sought: no fit is then held to positive coefficients.
    rules : Search
        Thresholds, ridge and largest support.
    optimizers : mapping of str to callable
        Those of `OPTIMIZERS` if not given.

    Returns
    -------
    dict of frozenset to tuple of str
        Places of the columns, and names of optimizers.
    """
    unit = theta / np.linalg.norm(theta, axis=0)
    problem = SparseProblem(unit, target / np.linalg.norm(target), rng, signed, rules)
    found: dict[frozenset[int], tuple[str, ...]] = {}
    for name, path in (OPTIMIZERS if optimizers is None else optimizers).items():
        for row in path(problem):
            support = frozenset(int(j) for j in np.flatnonzero(row))
            if 0 < len(support) <= rules.largest_support and name not in found.get(support, ()):
                found[support] = (*found.get(support, ()), name)
    return found


@contextmanager
def _global_seed(rng: np.random.Generator) -> Iterator[None]:
    """Seed for a while the global state that EnsembleOptimizer draws from, and put it back."""
    before = np.random.get_state()  # noqa: NPY002 - pysindy draws from it
    np.random.seed(int(rng.integers(2**31)))  # noqa: NPY002 - the same
    try:
        yield
    finally:
        np.random.set_state(before)  # noqa: NPY002 - the same
