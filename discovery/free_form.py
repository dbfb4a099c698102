"""A term for a residual that no effect of the catalogue explains: sparse sums over the motion, by pysindy.

    F = sum_j g_j phi_j(x, v, T)

in one link; in one to the ground x and v are those of a body. The columns are the whitened outputs of the
terms, what the model's numbers can imitate taken off, so that a sparse fit of them is an output-error fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from discovery.attribution import explanation, output_of
from discovery.explanation import Explanation
from discovery.regression import sparse_supports, usable
from discovery.tracing import Evidence
from rom.channels import FloatArray
from rom.effects import Effect, Member, free_form
from rom.laws import Parameter
from rom.structure import GROUND

Terms = Mapping[str, tuple[float, ...]]
_TERMS: Terms = {  # expression and the powers of N, m, s in its coefficient's unit
    "x ** 2": (1, -2, 0),
    "abs(x) * x": (1, -2, 0),
    "x ** 3": (1, -3, 0),
    "x ** 5": (1, -5, 0),
    "v ** 2": (1, -2, 2),
    "abs(v) * v": (1, -2, 2),
    "v ** 3": (1, -3, 3),
    "sign(v) * sqrt(abs(v))": (1, -0.5, 0.5),
    "tanh(v / {v})": (1, 0, 0),
    "abs(x) * v": (1, -2, 1),
    "x * v": (1, -2, 1),
    "x ** 2 * v": (1, -3, 1),
    "x * v ** 2": (1, -3, 2),
    "x * abs(v)": (1, -2, 1),
    "max(x, 0)": (1, -1, 0),
    "max(v, 0)": (1, -1, 1),
    "max(abs(x) - {x}, 0) * sign(x)": (1, -1, 0),
}
_OF_TENSION: Terms = {
    "T * tanh(v / {v})": (0, 0, 0),
    "T * x": (0, -1, 0),
    "T * v": (0, -1, 1),
    "T * x ** 2": (0, -2, 0),
}
MOST_TERMS = 3
PRICE = 12.0
"""In cost, of a term."""
_TYPICAL = 0.1  # of the largest velocity, where a sign turns


def free_forms(evidence: Evidence, seed: int = 0) -> tuple[Explanation, ...]:
    """Fit the best sparse sum of terms at every link, each with its costs on held-out records too."""
    model = evidence.baseline.model
    taken = {effect.enters for effect in model.effects if effect.name == "free-form"}
    found = []
    for link in model.structure.links:
        ends = (link.first, link.second)
        if link.name in taken:
            continue
        terms = {**_TERMS, **(_OF_TENSION if link.law == "bolted" else {})}
        if GROUND in ends:
            terms = {text: unit for text, unit in terms.items() if "T" not in text.replace("tanh", "")}
        found.append(_best_sum(evidence, link.name, _scaled(terms, ends, evidence), seed))
    return tuple(one for one in found if one is not None)


def _scaled(terms: Terms, ends: tuple[str, str], evidence: Evidence) -> Terms:
    """Terms with the scales of the motion in them."""
    peaks = np.array([[np.abs(m).max() for m in trace.relative(ends)] for trace in evidence.traces])
    x, v = (float(f"{value:.2g}") for value in np.median(peaks, axis=0))
    return {text.format(v=f"{_TYPICAL * v:.3g}", x=f"{0.5 * x:.3g}"): unit for text, unit in terms.items()}


def _best_sum(evidence: Evidence, enters: str, terms: Terms, seed: int) -> Explanation | None:
    """The sum of lowest cost with a price for every term."""
    left = evidence.beyond(evidence.residual)
    texts = list(terms)
    columns = np.stack(
        [evidence.beyond(output_of(_sum([text], [1.0], enters, terms), evidence)) for text in texts], axis=1
    )
    names = [str(k) for k in range(len(texts))]
    sound = [k for k in range(len(texts)) if np.isfinite(columns[:, k]).all()]
    kept, _ = usable(columns[:, sound], [names[k] for k in sound])
    if len(kept) < 2:
        return None
    place = [sound[k] for k in kept]
    basis, triangle = np.linalg.qr(columns[:, place])
    target = basis.T @ left
    supports = sparse_supports(triangle, target, np.random.default_rng(seed))
    spread = max(float(left @ left) / len(left), 1.0)
    best, lowest = None, np.inf
    for support in supports:
        if len(support) > MOST_TERMS:
            continue
        chosen = sorted(support)
        values, residual = _least_squares(triangle[:, chosen], target)
        cost = residual / spread + PRICE * len(chosen)
        if cost < lowest:
            best, lowest = ([texts[place[k]] for k in chosen], values), cost
    if best is None:
        return None
    effect = _sum(best[0], list(best[1]), enters, terms)
    return explanation(effect, _member(effect), evidence)


def _least_squares(columns: FloatArray, target: FloatArray) -> tuple[FloatArray, float]:
    values = np.asarray(np.linalg.lstsq(columns, target, rcond=None)[0], dtype=np.float64)
    return values, float(np.sum((target - columns @ values) ** 2))


def _sum(texts: Sequence[str], values: Sequence[float], enters: str, terms: Terms) -> Effect:
    """The force of a sum of terms."""
    equation = " + ".join(f"g_{j} * ({text})" for j, text in enumerate(texts, 1))
    parameters = {
        f"g_{j}": Parameter(float(value), _unit(terms[text]))
        for j, (text, value) in enumerate(zip(texts, values, strict=True), 1)
    }
    effect = free_form(equation, enters, parameters)
    assert isinstance(effect, Effect)
    return effect


def _unit(powers: tuple[float, ...]) -> str:
    parts = [
        f"{base}^{p:g}" if p != 1 else base for base, p in zip(("N", "m", "s"), powers, strict=True) if p
    ]
    return " ".join(parts) or "1"


def _member(effect: Effect) -> Member:
    """What a fit needs to know of a free form: all its numbers are strengths."""
    names = dict(effect.parameters)
    return Member(
        effect.name, ("joint",), effect.equation, names, {name: p.value for name, p in names.items()}, (),
        "found from the residual", effect.function,
    )  # fmt: skip
