"""Forces of a model's links: along a prescribed motion, and at rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from rom.model.assembly import Assembly
from rom.model.effect import Effect

FloatArray = npt.NDArray[np.float64]
_ODD_S = 0.123456789  # a time at which no force that goes with time has the value that it has at 0
_ITERATIONS = 30


def link_force(
    assembly: Assembly,
    link: str,
    displacement: npt.ArrayLike,
    rate_hz: float,
    tension: npt.ArrayLike,
    *,
    settled: bool,
) -> FloatArray:
    """See ``Model.link_force``."""
    if link not in assembly.link_laws:
        raise ValueError(f"link must be one of {sorted(assembly.link_laws)}, got {link!r}")
    x = np.asarray(displacement, dtype=np.float64)
    held = np.broadcast_to(np.maximum(np.asarray(tension, dtype=np.float64), 0.0), x.shape)
    laws, velocity = assembly.link_laws[link], np.gradient(x, 1 / rate_hz)
    motion = np.stack([x, velocity, held, laws.stiffness(held), laws.damping(held)])
    force = motion[3] * x + motion[4] * velocity
    return np.asarray(force + force_of_effects(assembly, link, motion, 1 / rate_hz, settled=settled))


def force_of_effects(
    assembly: Assembly, link: str, motion: FloatArray, step_s: float, *, settled: bool = False
) -> FloatArray:
    """Force of a link's effects [N] along a motion, shape (5, samples): rows x, v, T, k, c.

    Steps are 0.5 ms, half a sample and a hundredth of the stroke at most. They are halved where that is
    unstable.

    Parameters
    ----------
    assembly : Assembly
        The model's tables and coefficients.
    link : str
        The link.
    motion : ndarray, shape (5, samples)
        Rows x [m], v [m/s], T [N], k [N/m], c [N s/m].
    step_s : float
        Time between samples [s].
    settled : bool
        Whether states start as the same motion backwards leaves them.

    Returns
    -------
    ndarray
        Force [N], shape (samples,).
    """
    row = assembly.structure.link_names.index(link)
    program, own = assembly.program, slice(*assembly.program.effect_start[row : row + 2])
    effects = assembly.effects[own]
    if not effects:
        return np.zeros(motion.shape[1])
    return force_along(program.effects[own], assembly.coefficients, motion, step_s, effects, settled=settled)


def force_along(
    table: npt.NDArray[np.int64],
    values: FloatArray,
    motion: FloatArray,
    step_s: float,
    effects: Sequence[Effect],
    *,
    settled: bool,
) -> FloatArray:
    """Force [N] of compiled effects along a motion.

    Parameters
    ----------
    table : ndarray, shape (effects, 3)
        Address, place of the first parameter, place of the first state.
    values : ndarray
        Parameters.
    motion : ndarray, shape (5, samples)
        x [m], v [m/s], T [N], k [N/m], c [N s/m].
    step_s : float
        Time between samples [s].
    effects : sequence of Effect
        Those of the table: what their states are at the start.
    settled : bool
        Whether states start as the same motion backwards leaves them.

    Returns
    -------
    ndarray, shape (samples,)
        Force [N]; not a number from where the states leave all bounds.
    """
    from rom.kernels.prescribed import force_of_effects as along

    before = np.ascontiguousarray(motion[:, ::-1])
    before[1] *= -1.0
    first = before if settled else motion
    # one more number than states, so that an effect without any has a valid place
    state = np.concatenate([*(effect.first_states(first[0, 0], first[1, 0]) for effect in effects), [0.0]])
    if settled and len(state) > 1:
        along(table, values, before, step_s, state, 0.0)
    return np.asarray(along(table, values, motion, step_s, state, 0.0))


def equilibrium(assembly: Assembly, tension: Mapping[str, float]) -> Mapping[str, float]:
    """Where the bodies rest [m] under the forces of the effects, by body, at tensions by bolted link.

    Forces that go with time count for nothing, states are those of a start there. Empty where nothing pushes
    at zero, or where no place of rest is found: a body that floats.
    """
    bodies = assembly.structure.body_names
    if not len(assembly.program.effects):
        return {}
    x = np.zeros(len(bodies))
    force = _force_on_bodies(assembly, x, tension)
    largest = float(np.abs(force).max())
    if largest == 0.0 or not np.isfinite(largest):
        return {}
    for _ in range(_ITERATIONS):
        steps = np.diag(np.maximum(1e-6 * np.abs(x), 1e-9))
        columns = [
            (_force_on_bodies(assembly, x + d, tension) - _force_on_bodies(assembly, x - d, tension))
            / (2 * d.max())
            for d in steps
        ]
        if not np.isfinite(columns).all():
            return {}
        x = x - np.linalg.lstsq(np.stack(columns, axis=1), force, rcond=1e-10)[0]
        force = _force_on_bodies(assembly, x, tension)
        if float(np.abs(force).max()) <= 1e-10 * largest:
            return dict(zip(bodies, x.tolist(), strict=True))
    return {}


def _force_on_bodies(assembly: Assembly, x: FloatArray, tension: Mapping[str, float]) -> FloatArray:
    """Force that pulls every body back while nothing moves [N]."""
    program, structure = assembly.program, assembly.structure
    bolts = structure.bolted_links
    total = np.zeros(len(x))
    for row, (first, second) in enumerate(program.ends):
        relative = (x[first] if first >= 0 else 0.0) - (x[second] if second >= 0 else 0.0)
        held = tension[bolts[program.tension[row]]] if program.tension[row] >= 0 else 0.0
        stiffness = damping = 0.0
        if row < len(structure.links):
            laws = assembly.link_laws[structure.link_names[row]]
            stiffness, damping = float(laws.stiffness(held)), float(laws.damping(held))
        still = np.array([[relative], [0.0], [held], [stiffness], [damping]])
        force = stiffness * relative + _steady(assembly, row, still)
        if first >= 0:
            total[first] += force
        if second >= 0:
            total[second] -= force
    return total


def _steady(assembly: Assembly, row: int, still: FloatArray) -> float:
    """Force of those effects of a row that do not go with time."""
    from rom.kernels import prescribed

    program, total = assembly.program, 0.0
    for place in range(*program.effect_start[row : row + 2]):
        alone, p = program.effects[place : place + 1], assembly.coefficients
        state = np.append(assembly.effects[place].first_states(still[0, 0], 0.0), 0.0)
        now, then = (prescribed.force_of_effects(alone, p, still, 1.0, state, t)[0] for t in (0.0, _ODD_S))
        total += now if now == then else 0.0
    return total
