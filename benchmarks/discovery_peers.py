"""Other programs that find equations, on the records that discovery has: laws as a user of theirs would get.

They want the rate of the tension as numbers at samples (the strong form). Their tension is the measured
non-oscillatory one, smoothed and differentiated by pysindy's own method; their velocity and displacement are
those of the identified model, without noise, as discovery has them. Only pysindy belongs to the project;
PyOperon, gplearn and jaxsr take part where they can be imported.
"""

from __future__ import annotations

import re
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec

import numpy as np

from discovery.courses.frozen_motion import FrozenMotion
from rom.campaign.campaign import Campaign
from rom.campaign.channels import FloatArray
from rom.model.laws import Law, free_form_law
from rom.signals.processing import process

WINDOW_S = 0.25  # after the hit; the losses of nominal hits are over by then
ROWS = 4000  # of symbolic regression, drawn from all
DEGREE = 5  # |v|^4 T is of fifth degree
SHARES = (0.02, 0.05, 0.1, 0.2, 0.4)


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of every training case after its hit, and the largest or median sizes of T, v and x."""

    time: tuple[FloatArray, ...]
    tension: tuple[FloatArray, ...]
    motion: tuple[FloatArray, ...]  # (samples, 2): v, x
    scale: tuple[float, float, float]

    def rows(self) -> tuple[FloatArray, FloatArray]:
        """Scaled T, |v|, |x| and scaled smoothed rates of all cases together; scale of rates: T a second."""
        from pysindy import SmoothedFiniteDifference

        columns, rates = [], []
        for when, tension, motion in zip(self.time, self.tension, self.motion, strict=True):
            slope = SmoothedFiniteDifference()._differentiate(tension[:, None], when[:, None][:, 0])
            columns.append(np.column_stack([tension, np.abs(motion)]) / self.scale)
            rates.append(slope[:, 0] / self.scale[0])
        return np.concatenate(columns), np.concatenate(rates)


@dataclass(frozen=True)
class Found:
    """A peer's law, None where it found none, and the time it took [s]."""

    law: Law | None
    seconds: float


def samples_of(campaign: Campaign, frozen: FrozenMotion) -> Samples:
    """Read the measured tension of the training records again, with the motion that discovery uses."""
    by_file = {record.file: record for record in campaign.settings.record}
    times, tensions, motions = [], [], []
    for case, course in enumerate(frozen.courses):
        measured = process(campaign.load(by_file[course.file]), campaign.settings).tension
        if measured is None:
            continue
        first = int(np.ceil(course.impact_s * measured.rate_hz))
        part = measured.non_oscillatory[first : first + int(WINDOW_S * measured.rate_hz)]
        when = np.arange(first, first + len(part)) / measured.rate_hz
        nodes = frozen.of_case(case)
        x, v = (np.interp(when - course.impact_s, nodes[0], nodes[k]) for k in (1, 2))
        times.append(when - when[0])
        tensions.append(part)
        motions.append(np.column_stack([v, x]))
    largest = np.median([np.abs(motion).max(axis=0) for motion in motions], axis=0)
    scale = (float(np.median([t.mean() for t in tensions])), float(largest[0]), float(largest[1]))
    return Samples(tuple(times), tuple(tensions), tuple(motions), scale)


def rate_law(name: str, text: str) -> Law | None:
    """The law of an expression in T, v and x; None where the text is none, or is a constant zero."""
    try:
        return free_form_law(name, text, "tension rate", {})
    except (SyntaxError, ValueError):
        return None


def in_physical_units(text: str, scale: tuple[float, float, float]) -> str:
    """An expression in scaled T, v and x, absolute values meant, with the scales put back."""
    names = {"T": f"(T / {scale[0]!r})", "v": f"(abs(v) / {scale[1]!r})", "x": f"(abs(x) / {scale[2]!r})"}
    placed = re.sub(r"\b[Tvx]\b", lambda found: names[found[0]], text)
    return f"{scale[0]!r} * ({placed})"


def polynomial(powers: Sequence[Sequence[int]], coefficients: Sequence[float]) -> str:
    """Text of a polynomial in T, v and x."""
    parts = []
    for exponents, value in zip(powers, coefficients, strict=True):
        if value:
            factors = [f"{name} ** {k}" for name, k in zip("Tvx", exponents, strict=True) if k]
            parts.append(" * ".join([repr(float(value)), *factors]))
    return " + ".join(parts) or "0 * T"


def sindy_as_documented(samples: Samples) -> str:
    """``SINDy(...).fit(x, t, u=...)`` with its guide's defaults, in SI units, polynomials of degree 5."""
    from pysindy import STLSQ, FiniteDifference, PolynomialLibrary, SINDy

    model = SINDy(
        optimizer=STLSQ(),
        feature_library=PolynomialLibrary(degree=DEGREE),
        differentiation_method=FiniteDifference(),
    )
    states = [tension[:, None] for tension in samples.tension]
    model.fit(states, t=list(samples.time), u=list(samples.motion), feature_names=["T", "v", "x"])
    return polynomial(model.feature_library.powers_.tolist(), model.coefficients()[0].tolist())


def sindy_with_care(samples: Samples) -> Iterator[str]:
    """Scaled columns of known sign, smoothed derivative, normalised; a law for every threshold tried."""
    from pysindy import STLSQ, PolynomialLibrary

    columns, rates = samples.rows()
    library = PolynomialLibrary(degree=DEGREE, include_bias=False).fit(columns)
    theta = np.asarray(library.transform(columns))
    for share in SHARES:
        optimizer = STLSQ(threshold=share * float(np.linalg.norm(rates)), alpha=1e-3, normalize_columns=True)
        found = optimizer.fit(theta, rates).coef_[0]
        if np.any(found):
            yield in_physical_units(polynomial(library.powers_.tolist(), found.tolist()), samples.scale)


def drawn_rows(samples: Samples, seed: int) -> tuple[FloatArray, FloatArray]:
    """Rows for symbolic regression: half of them the strongest motion, half drawn from all."""
    columns, rates = samples.rows()
    rng = np.random.default_rng(seed)
    strongest = np.argsort(-columns[:, 1])[: ROWS // 2]
    chosen = np.union1d(strongest, rng.choice(len(rates), ROWS // 2, replace=False))
    return columns[chosen], rates[chosen]


def operon(columns: FloatArray, rates: FloatArray, seed: int, budget_s: float) -> str:
    """PyOperon: genetic programming with constants fitted by Levenberg-Marquardt."""
    model = import_module("pyoperon.sklearn").SymbolicRegressor(
        allowed_symbols="add,sub,mul,constant,variable,square",
        max_length=25,
        optimizer_iterations=5,
        max_time=int(budget_s),
        random_state=seed,
    )
    model.fit(columns, rates)
    return str(model.get_model_string(model.model_, 9, ["T", "v", "x"])).replace("^", "**")


def gplearn(columns: FloatArray, rates: FloatArray, seed: int, budget_s: float) -> str:
    """gplearn: generation by generation until the budget is spent."""
    started = time.perf_counter()
    model = import_module("gplearn.genetic").SymbolicRegressor(
        population_size=1000, generations=1, function_set=("add", "sub", "mul"), random_state=seed,
        parsimony_coefficient=1e-4, feature_names=("T", "v", "x"), warm_start=True,
    )  # fmt: skip
    while time.perf_counter() - started < budget_s:
        model.fit(columns, rates)
        model.set_params(generations=model.generations + 1)
    return infix(str(model._program))


def infix(text: str) -> str:
    """``add(T, mul(v, v))`` as arithmetic."""
    signs = {"add": "+", "sub": "-", "mul": "*"}

    def read(tokens: list[str]) -> str:
        token = tokens.pop(0)
        if token not in signs:
            return f"({token})"
        first, second = read(tokens), read(tokens)
        return f"({first} {signs[token]} {second})"

    return read(re.findall(r"[A-Za-z]+|-?[\d.]+(?:e-?\d+)?", text))


def jaxsr(columns: FloatArray, rates: FloatArray, seed: int, budget_s: float) -> str:  # noqa: ARG001 - it has none
    """jaxsr: sparse selection from polynomials by BIC."""
    package = import_module("jaxsr")
    library = (
        package.BasisLibrary(n_features=3, feature_names=["T", "v", "x"])
        .add_linear()
        .add_polynomials(max_degree=DEGREE)
        .add_polynomial_interactions(max_total_degree=DEGREE, max_individual_degree=4)
    )
    model = package.SymbolicRegressor(basis_library=library, max_terms=4, random_state=seed)
    model.fit(columns, rates)
    return str(model.expression_).partition("=")[2].replace("^", "**").strip().replace("- ", "-", 1)


SYMBOLIC: Mapping[str, tuple[str, Callable[[FloatArray, FloatArray, int, float], str]]] = {
    "PyOperon": ("pyoperon", operon),
    "gplearn": ("gplearn", gplearn),
    "jaxsr": ("jaxsr", jaxsr),
}


def missing() -> tuple[str, ...]:
    """Names of the peers that are not installed."""
    return tuple(name for name, (module, _) in SYMBOLIC.items() if find_spec(module) is None)


def laws_of_peers(
    campaign: Campaign,
    frozen: FrozenMotion,
    error: Callable[[Law, FrozenMotion], float],
    seed: int = 0,
    budget_s: float = 60.0,
) -> dict[str, Found]:
    """Return the law of every peer that is installed.

    Where a peer leaves the threshold to its user, the law of the smallest ``error`` by re-simulation over the
    training records is taken: more than its guide does.
    """
    samples = samples_of(campaign, frozen)
    found = {
        "pysindy, as in its guide": _timed(lambda: [sindy_as_documented(samples)]),
        "pysindy, scaled, smoothed, threshold by re-simulation": _timed(
            lambda: list(sindy_with_care(samples)), lambda law: error(law, frozen)
        ),
    }
    for name, (module, fit) in SYMBOLIC.items():
        if find_spec(module) is not None:
            found[name] = _timed(partial(_symbolic, fit, samples, seed, budget_s))
    return found


def _symbolic(
    fit: Callable[[FloatArray, FloatArray, int, float], str], samples: Samples, seed: int, budget_s: float
) -> list[str]:
    columns, rates = drawn_rows(samples, seed)
    return [in_physical_units(fit(columns, rates, seed, budget_s), samples.scale)]


def _timed(texts: Callable[[], list[str]], error: Callable[[Law], float] | None = None) -> Found:
    started = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        laws = [law for text in texts() if (law := rate_law("peer", text)) is not None]
    if error is not None:
        laws.sort(key=error)
    return Found(laws[0] if laws else None, time.perf_counter() - started)
