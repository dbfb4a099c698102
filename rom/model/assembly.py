"""From a model to the tables of the kernels, and from their arrays to a response."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from rom.model.description import PLACES, LinkLaws, ModelDescription
from rom.model.effect import Effect
from rom.model.laws import constant_stiffness
from rom.model.structure import Structure
from rom.result_views import HasViews

if TYPE_CHECKING:
    from rom.kernels.equations import Program

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Status = Literal["ok", "diverged"]
TOLERANCE = 1.5e-6  # of a final tension relative to its change, of a velocity relative to its peak
DENSE_BODIES = 60  # larger structures go link by link


@dataclass(frozen=True)
class Response(HasViews):
    """The simulated response to a record of force, at the force's own samples.

    Attributes
    ----------
    status : {"ok", "diverged"}
        A diverged response holds NaN from the first sample that could not be reached, be it that numbers
        grew beyond all bounds or that more steps were needed than a record may take; of the last sample
        reached the accelerations may be infinite.
    time : ndarray
        Time [s] from the first sample, shape (samples,).
    displacement, velocity, acceleration : mapping of str to ndarray
        By body [m], [m/s], [m/s2].
    tension : ndarray or mapping of str to ndarray
        Tension [N]; by link where there are several bolted links, empty where there is none.
    states : ndarray
        Internal states of the effects, shape (states, samples).
    steps : int
        Steps taken.
    estimated_error : float
        Estimated error of the final tension relative to the tension's greatest change; NaN where the
        method has no estimate.

    Examples
    --------
    >>> import numpy as np, rom
    >>> time = np.arange(0.0, 0.5, 1 / 19200)
    >>> force = np.where(time < 0.00065, 1608.7 * np.sin(np.pi * time / 0.00065), 0.0)
    >>> response = rom.paper_model().simulate({"lo": force}, rate_hz=19200, initial_tension=152.7)
    >>> print(response.summary().splitlines()[0])
    ok: 9600 samples to 0.499948 s
    >>> bool(response.to_frame()["tension"].iloc[-1] < 152.7)
    True
    """

    status: Status
    time: FloatArray
    displacement: Mapping[str, FloatArray]
    velocity: Mapping[str, FloatArray]
    acceleration: Mapping[str, FloatArray]
    tension: FloatArray | Mapping[str, FloatArray]
    states: FloatArray
    steps: int
    estimated_error: float

    def __repr__(self) -> str:
        bodies = ", ".join(self.displacement)
        return f"Response({self.status!r}, {len(self.time)} samples of {bodies})"


@dataclass(frozen=True)
class Assembly:
    """What a simulation needs of a model: tables, coefficients, and where each parameter is among them."""

    structure: Structure
    link_laws: Mapping[str, LinkLaws]
    program: Program
    coefficients: FloatArray
    active: IntArray
    places: Mapping[str, int]
    effects: tuple[Effect, ...]

    def full_start(self, motion: FloatArray) -> FloatArray:
        """Displacements, velocities and the states of the effects at the start, (2 bodies + states,).

        Parameters
        ----------
        motion : ndarray, shape (2 bodies,)
            Displacements [m] and velocities [m/s].
        """
        ground = np.append(motion.reshape(2, -1), np.zeros((2, 1)), axis=1)  # which index -1 finds
        rows = np.repeat(np.arange(len(self.program.ends)), np.diff(self.program.effect_start))
        states = [
            effect.first_states(*(ground[:, first] - ground[:, second]))
            for (first, second), effect in zip(self.program.ends[rows], self.effects, strict=True)
        ]
        return np.concatenate([motion, *states])


class _Layout:
    """Coefficients as they are laid out one after the other, and their places by path."""

    def __init__(self) -> None:
        self.values: list[float] = []
        self.places: dict[str, int] = {}

    def add(self, path: str, names: Iterable[str], values: Iterable[float]) -> int:
        """Append values under their paths; the offset of the first."""
        offset = len(self.values)
        self.places.update({f"{path}.{name}": offset + i for i, name in enumerate(names)})
        self.values.extend(float(value) for value in values)
        return offset


def assemble(model: ModelDescription) -> Assembly:
    """Tables and coefficients of a model; compiles those laws that are new to this process."""
    from rom.kernels.equations import Program

    structure, (link_laws, changes) = model.structure, model.changed_laws
    layout = _Layout()
    layout.add("body", (f"{name}.mass" for name in structure.body_names), structure.masses)
    zero = layout.add("", (), (0.0,))
    driven = [(_link_index(structure, e.enters), e) for e in model.effects_of("force")]
    laws = [_law_row(layout, name, link_laws[name]) for name in structure.link_names]
    nothing = constant_stiffness(0.0).address
    loaded = sorted({link for link, _ in driven if link >= len(laws)})  # bodies with effects of their own
    body_rows = {link: len(laws) + i for i, link in enumerate(loaded)}
    laws += [[nothing, zero, nothing, zero, 0, 0] for _ in loaded]
    ends = np.array([*structure.ends.tolist(), *([link - len(structure.links), -1] for link in loaded)])
    rows = sorted(((body_rows.get(link, link), effect) for link, effect in driven), key=lambda pair: pair[0])
    table, states = [], 0
    for _, effect in rows:
        table.append(
            [
                effect.address,
                layout.add(f"{effect.enters}.{effect.name}", effect.parameters, effect.values),
                states,
            ]
        )
        states += effect.states
    program = Program(
        ends=_table(ends, 2),
        tension=_tension_seen(structure, link_laws, [row for row, _ in rows], len(laws)),
        laws=_table(laws, 6),
        effects=_table(table, 3),
        effect_start=np.searchsorted([row for row, _ in rows], np.arange(len(laws) + 1)).astype(np.int64),
        size=np.array([len(structure.bodies), len(structure.bolted_links), states], dtype=np.int64),
    )
    loaded_rows = np.diff(program.effect_start) > 0
    active = np.flatnonzero((program.tension >= 0) | loaded_rows).astype(np.int64)
    # one more number, so that a law without parameters has a valid place behind the last one
    coefficients = np.array([*layout.values, 0.0])
    places = layout.places | {path: layout.places[inner] for path, inner in changes.items()}
    effects = tuple(effect for _, effect in rows)
    return Assembly(structure, link_laws, program, coefficients, active, MappingProxyType(places), effects)


def _table(rows: npt.ArrayLike, columns: int) -> IntArray:
    return np.ascontiguousarray(np.asarray(rows, dtype=np.int64).reshape(-1, columns))


def _law_row(layout: _Layout, link: str, laws: LinkLaws) -> list[int]:
    row = []
    for kind, law in zip(PLACES, (laws.stiffness, laws.damping, laws.tension_rate), strict=True):
        if law is None:
            row += [0, 0]
        else:
            row += [law.address, layout.add(f"{link}.{kind}", law.parameters, law.values)]
    return row


def _link_index(structure: Structure, enters: str) -> int:
    """Row of the link where an effect enters; behind the links, a row for every body."""
    if enters == "tension":
        return structure.link_names.index(structure.bolted_links[0])
    if enters.startswith("body:"):
        return len(structure.links) + structure.body_names.index(enters.removeprefix("body:"))
    return structure.link_names.index(enters)


def _tension_seen(
    structure: Structure, link_laws: Mapping[str, LinkLaws], loaded: list[int], rows: int
) -> IntArray:
    """A bolted link sees its own tension, every other one that of the only bolt if it can depend on it."""
    bolts = structure.bolted_links
    seen = np.full(rows, -1, dtype=np.int64)
    for row, name in enumerate(structure.link_names):
        laws = link_laws[name]
        if name in bolts:
            seen[row] = bolts.index(name)
        elif len(bolts) == 1 and (laws.stiffness.sees_tension or laws.damping.sees_tension):
            seen[row] = 0
    if len(bolts) == 1:
        seen[loaded] = 0
    return seen


def number(name: str, value: object, low: float = -np.inf, *, strict: bool = False) -> float:
    """A finite number not below (strictly: above) ``low``.

    Parameters
    ----------
    name : str
        Name for the message.
    value : object
        What was given.
    low : float
        Least value allowed.
    strict : bool
        Whether ``low`` itself is refused.

    Returns
    -------
    float
        The number.
    """
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number) or number < low or (strict and number == low):
        sign = ">" if strict else ">="
        raise ValueError(f"{name} must be a finite number {sign} {low:g}, got {value!r}")
    return number


def forces_on(structure: Structure, force: Mapping[str, npt.ArrayLike]) -> tuple[IntArray, FloatArray]:
    """Indices of the driven bodies and their forces, shape (driven, samples)."""
    if not isinstance(force, Mapping) or not force:
        raise ValueError(
            f"force must map bodies to arrays, one at least, got {type(force).__name__} {force!r:.60}"
        )
    unknown = sorted(set(force) - set(structure.body_names))
    if unknown:
        raise ValueError(f"force must act on {', '.join(structure.body_names)}, got {', '.join(unknown)}")
    arrays = {name: np.asarray(samples, dtype=np.float64) for name, samples in force.items()}
    shapes = {name: array.shape for name, array in arrays.items()}
    if len(set(shapes.values())) > 1 or any(len(s) != 1 or s[0] < 2 for s in shapes.values()):
        raise ValueError(
            f"forces must be 1-D arrays of one length of at least 2 samples, got shapes {shapes}"
        )
    for name, array in arrays.items():
        if not np.isfinite(array.sum()):
            raise ValueError(f"force on {name!r} must be finite, got NaN or infinity")
    driven = np.array([structure.body_names.index(name) for name in arrays], dtype=np.int64)
    return driven, np.stack(list(arrays.values()))


def _by_body(structure: Structure, name: str, values: Mapping[str, float] | None) -> list[float]:
    values = values or {}
    unknown = sorted(set(values) - set(structure.body_names))
    if unknown:
        raise ValueError(f"{name} must name {', '.join(structure.body_names)}, got {', '.join(unknown)}")
    return [number(f"{name} of {body!r}", values.get(body, 0.0)) for body in structure.body_names]


def _tensions(structure: Structure, initial: float | Mapping[str, float] | None) -> list[float]:
    bolts = structure.bolted_links
    if not isinstance(initial, Mapping):
        if (initial is None) != (not bolts) or len(bolts) > 1:
            raise ValueError(f"initial_tension must be given for the bolted links {bolts}, got {initial!r}")
        initial = {} if initial is None else {bolts[0]: initial}
    if set(initial) != set(bolts):
        raise ValueError(f"initial_tension must be given for the bolted links {bolts}, got {tuple(initial)}")
    return [number(f"initial_tension of {bolt!r}", initial[bolt], 0.0) for bolt in bolts]


def tensions_of(structure: Structure, initial: float | Mapping[str, float] | None) -> Mapping[str, float]:
    """Initial tensions by bolted link, checked."""
    return dict(zip(structure.bolted_links, _tensions(structure, initial), strict=True))


def simulate(
    assembly: Assembly,
    force: Mapping[str, npt.ArrayLike],
    rate_hz: float,
    initial_tension: float | Mapping[str, float] | None,
    initial_displacement: Mapping[str, float] | None,
    initial_velocity: Mapping[str, float] | None,
    tolerance: float,
) -> Response:
    """See ``Model.simulate``."""
    from rom.kernels.exponential_integrator import Task, integrate
    from rom.kernels.runge_kutta import integrate_links

    structure = assembly.structure
    rate = number("rate_hz", rate_hz, 0.0, strict=True)
    driven, forces = forces_on(structure, force)
    tensions = np.array(_tensions(structure, initial_tension))
    motion = np.array(
        [
            *_by_body(structure, "initial_displacement", initial_displacement),
            *_by_body(structure, "initial_velocity", initial_velocity),
        ]
    )
    start = assembly.full_start(motion)
    samples, bodies = forces.shape[1], len(structure.bodies)
    last = np.array([samples - 1, samples])
    task = Task(rate, driven, assembly.active, fixed(forces), start, tensions, last, 1, tolerance)
    out = np.full((3 * bodies + int(assembly.program.size[1:].sum()), samples), np.nan)
    report = np.zeros(6 + int(assembly.program.size[2]))
    if bodies > DENSE_BODIES:
        integrate_links(assembly.program, assembly.coefficients, task, report, out)
        report[1:3] = np.nan
    else:
        one = task._replace(force=task.force[None], tensions=tensions[None], edges=last[None])
        integrate(assembly.program, assembly.coefficients[None], one, report[None], out[None])
    return _response(structure, rate, out, report)


def _response(structure: Structure, rate: float, out: FloatArray, report: FloatArray) -> Response:
    steps, motion_error, tension_error, reached, peak, loss = report[:6]
    n, bolts = len(structure.bodies), structure.bolted_links

    def by_body(rows: FloatArray) -> Mapping[str, FloatArray]:
        return MappingProxyType(dict(zip(structure.body_names, rows, strict=True)))

    tensions = out[2 * n : 2 * n + len(bolts)]
    return Response(
        status="ok" if reached == out.shape[1] and np.isfinite(out[-n:]).all() else "diverged",
        time=np.arange(out.shape[1]) / rate,
        displacement=by_body(out[:n]),
        velocity=by_body(out[n : 2 * n]),
        acceleration=by_body(out[-n:]),
        tension=tensions[0] if len(bolts) == 1 else MappingProxyType(dict(zip(bolts, tensions, strict=True))),
        states=out[2 * n + len(bolts) : -n],
        steps=int(steps),
        estimated_error=float(
            np.maximum(motion_error / peak if peak else 0.0, tension_error / loss if loss else 0.0)
        ),
    )


def finite(name: str, values: npt.ArrayLike) -> FloatArray:
    """Values as an array, all finite."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if not np.isfinite(array.sum()):
        raise ValueError(f"{name} must be finite, got NaN or infinity")
    return array


def fixed(force: FloatArray) -> FloatArray:
    """A read-only view: kernels are compiled for one kind of array, mapped from a file or in memory."""
    view = force.view()
    view.flags.writeable = False
    return view
