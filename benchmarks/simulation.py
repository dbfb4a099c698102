"""Time and accuracy of the paper's model over 8 s at 19200 Hz: ``python -m benchmarks.simulation``.

One core, one run, ratios. Reference: the compiled Runge-Kutta method with 16 steps a sample, none of which
crosses a knot of the force; its own doubt is the difference to 8 steps. (The tests hold the engine to DOP853
at rtol 1e-12 from knot to knot.) The hit is the nominal pulse, once as it is and once with 0.2 N of noise on
the whole record, as measured. SciPy's solvers get a compiled right-hand side, the force by index, and steps
of at most 0.5 ms; LSODA once more with the equations in plain Python, as most would write them. They are
compared without noise, which they take 100 times longer for.
"""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Callable

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.peers import PEERS, RATE_HZ, FloatArray, runge_kutta
from rom.model.model import Model
from rom.parameters.he_2025 import paper_model

PRELOADS = (6.0, 20.0, 60.0, 150.0, 300.0, 700.0, 3000.0)
SAMPLES = int(8 * RATE_HZ)
NOISE_N = 0.2
NOTHING = np.empty((0, 0))


def hit(peak: float, noise: float, rng: np.random.Generator) -> FloatArray:
    """Nominal half-sine pulse after 0.5 s, with noise [N]."""
    t = np.arange(SAMPLES) / RATE_HZ - 0.5
    tau = 1.05e-3 * (peak / 28.0) ** -0.118
    return peak * np.sin(np.pi * t / tau) * ((t > 0) & (t < tau)) + noise * rng.normal(size=SAMPLES)


def seconds(call: Callable[[], object], repeats: int) -> float:
    """Shortest processor time of a call on this thread."""
    shortest = np.inf
    for _ in range(repeats):
        start = time.thread_time()
        call()
        shortest = min(shortest, time.thread_time() - start)
    return float(shortest)


def row(model: Model, tension: float, force: FloatArray) -> list[str]:
    """Errors and time of one case."""
    states = np.zeros((5, SAMPLES))
    states[4, 0] = tension
    loss = tension - runge_kutta(force, tension, 16, states)
    doubt = abs(tension - runge_kutta(force, tension, 8, NOTHING) - loss) / loss
    response = model.simulate({"lo": force}, RATE_HZ, tension)
    found = tension - model.final_tension(force[None], RATE_HZ, [tension])[0]
    pairs = ((response.displacement["lo"], states[0]), (response.displacement["so"], states[1]))
    moved = max(float(abs(ours - exact).max() / abs(exact).max()) for ours, exact in pairs)
    final = seconds(lambda: model.final_tension(force[None], RATE_HZ, [tension]), 20)
    full = seconds(lambda: model.simulate({"lo": force}, RATE_HZ, tension), 5)
    plain = seconds(lambda: runge_kutta(force, tension, 1, NOTHING), 3)
    errors = (doubt, abs(found - loss) / loss, response.estimated_error, moved)
    return [
        f"{tension:g}",
        f"{loss:.4g}",
        *(f"{error:.1e}" for error in errors),
        f"{1e3 * final:.2f}",
        f"{1e3 * full:.2f}",
        f"{plain / final:.0f}",
    ]


def by_preload(model: Model, noise: float) -> Table:
    """One case at every preload."""
    rng = np.random.default_rng(1)
    table = Table(title=f"One case of 8 s, 1608.7 N, {noise} N of noise; errors relative to loss and peak")
    names = "T0 N,loss N,reference doubt,loss error,estimate,displacement error,ms,ms all samples,times RK4"
    for name in names.split(","):
        table.add_column(name, justify="right")
    for tension in PRELOADS:
        table.add_row(*row(model, tension, hit(1608.7, noise, rng)))
    return table


def sweep(model: Model, noise: float, cases: int = 58) -> Table:
    """Final tension of every case of a campaign, as ratios of time."""
    rng = np.random.default_rng(58)
    tensions = np.geomspace(5.8, 3013.0, cases)
    forces = np.stack([hit(peak, noise, rng) for peak in rng.normal(1608.7, 81.65, cases)])
    exact = np.array([runge_kutta(f, T, 8, NOTHING) for f, T in zip(forces, tensions, strict=True)])
    ours = model.final_tension(forces, RATE_HZ, tensions)
    spent = seconds(lambda: model.final_tension(forces, RATE_HZ, tensions), 10)
    table = Table(title=f"{cases} cases of 8 s, {noise} N of noise, one law, one core")
    for name in ("", "largest error of the loss", "cases timed", "s for all", "times boltlaw"):
        table.add_column(name, justify="right")
    error = float(np.max(abs(ours - exact) / (tensions - exact)))
    table.add_row("boltlaw", f"{error:.1e}", f"{cases}", f"{spent:.4f}", "1")
    for name, peer in PEERS.items():
        compiled = "compiled" in name
        if noise and not compiled:
            continue
        some = np.arange(0, cases, 4 if compiled else 19)
        taken, wrong = [], 0.0
        for i in some:
            taken.append(seconds(lambda p=peer, i=i: p(forces[i], tensions[i]), 2))  # type: ignore[misc]
            wrong = max(wrong, abs(peer(forces[i], tensions[i]) - exact[i]) / (tensions[i] - exact[i]))
        total = float(np.mean(taken)) * cases
        table.add_row(name, f"{wrong:.1e}", f"{some.size}", f"{total:.3f}", f"{total / spent:.0f}")
    return table


def main() -> None:
    """Print all tables."""
    console, model = Console(width=150), paper_model()
    missing = [name for name in ("diffrax", "heyoka") if importlib.util.find_spec(name) is None]
    console.print(f"not installed, so not compared: {', '.join(missing) or 'none'}")
    for noise in (0.0, NOISE_N):
        console.print(sweep(model, noise))
        console.print(by_preload(model, noise))


if __name__ == "__main__":
    main()
