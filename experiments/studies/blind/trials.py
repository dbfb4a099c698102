"""How often the closed loop finds what a campaign of the virtual rig does not tell, and how well.

Campaigns with none, one or two undeclared effects of random strength are measured and closed on their folders
alone; a closure is scored against the truth file beside it, read only then. Every campaign leaves one file
when it is done; a run that was stopped goes on where it was.
"""

from __future__ import annotations

import json
import resource
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal
from zlib import crc32

import numpy as np

from discovery.localisation.localise import COURSES
from experiments.results import plain, writable, write_result
from experiments.studies import rig
from rom.campaign.campaign import read_campaign

Group = Literal["clean", "one", "outside", "two"]
Place = tuple[str, str]
"""Name of an effect and where it enters."""

PRELOADS = 20
DURATION_S = 2.5
HOLD_OUT_EVERY = 5
UNFELT = ("sensor:force_so",)
"""A hammer that strikes in one test alone, with one body, changes nothing of the others."""
ATTEMPTS = 5
"""Draws of strengths before two effects that diverge together are given up."""


@dataclass(frozen=True)
class Trial:
    """One campaign to be measured and closed: what it hides, its seed, and the factor on noise."""

    group: Group
    seed: int
    hidden: tuple[Place, ...] = ()
    noise: float = 1.0

    @property
    def label(self) -> str:
        """What it hides, for people."""
        return " + ".join(f"{name}@{enters}" for name, enters in self.hidden) or "clean"

    @property
    def file(self) -> str:
        """Name of its result file."""
        head = self.group if self.group in ("clean", "two") else self.label.replace(":", ".")
        return f"{head}-noise{self.noise:g}-seed{self.seed:04d}.json"

    def generator(self) -> np.random.Generator:
        """What its strengths and its campaign are drawn with."""
        return np.random.default_rng([self.seed, crc32(self.label.encode())])


def planned(
    clean: int = 0,
    each: int = 0,
    outside: int = 0,
    two: int = 0,
    names: Sequence[str] = (),
    noise: Sequence[float] = (1.0,),
    first: int = 0,
) -> tuple[Trial, ...]:
    """Return the trials of a test, those of the first seed first.

    Parameters
    ----------
    clean, two : int
        Campaigns without effect, and with a random pair of effects of different classes.
    each, outside : int
        Seeds for every core effect of the catalogue, and for every effect outside it. Where no place is
        named the seeds go round the places where it can enter, the usual one first.
    names : sequence of str
        ``NAME[@PLACE]``: only these effects; empty for all.
    noise : sequence of float
        Factors on the noise of the rig, of which each campaign draws one.
    first : int
        The first seed.

    Raises
    ------
    ValueError
        If there is no such effect or place.
    """
    chosen = [rig.undeclared_from_text(name) for name in names]
    given = [(one.name, one.enters if "@" in text else "") for one, text in zip(chosen, names, strict=True)]
    every = given or [(name, "") for name in _core() + _outside()]
    trials = []
    for number in range(max(clean, each, outside, two)):
        seed = first + number
        trials += [Trial("clean", seed, ())] * (number < clean)
        for name, place in every:
            group: Group = "outside" if rig.KINDS[name].outside else "one"
            places = (place,) if place else _places(name)
            hidden = ((name, places[seed % len(places)]),)
            wanted = number < (outside if group == "outside" else each)
            trials += [Trial(group, seed, hidden)] * wanted
        trials += [Trial("two", seed, _pair(seed))] * (number < two)
    return tuple(replace(trial, noise=_drawn(noise, trial)) for trial in trials)


def _drawn(noise: Sequence[float], trial: Trial) -> float:
    rng = np.random.default_rng([trial.seed, crc32(trial.label.encode()), crc32(b"noise")])
    return float(noise[int(rng.integers(len(noise)))])


def _core() -> list[str]:
    from rom.effects import CATALOGUE

    return [name for name in rig.KINDS if name in CATALOGUE and CATALOGUE[name].core]


def _outside() -> list[str]:
    return [name for name, kind in rig.KINDS.items() if kind.outside]


def _pair(seed: int) -> tuple[Place, ...]:
    """Two core effects that share no class, each at a place where it can enter."""
    from rom.effects import CATALOGUE

    rng, core = np.random.default_rng([seed, crc32(b"two")]), _core()
    one = core[rng.integers(len(core))]
    apart = [name for name in core if not {*CATALOGUE[one].classes} & {*CATALOGUE[name].classes}]
    names = one, apart[rng.integers(len(apart))]
    return tuple((n, _places(n)[rng.integers(len(_places(n)))]) for n in names)


def _places(name: str) -> tuple[str, ...]:
    """Where an effect can enter and be felt."""
    return tuple(place for place in rig.KINDS[name].allowed if place not in UNFELT)


def run_trial(trial: Trial, out: Path) -> str:
    """Measure, close, score against the truth, and write the result; return one line for people.

    A fault of the program is a result too: it is told, counted, and tried again by the next run.
    """
    started = time.perf_counter()
    content: dict[str, Any] = {
        "group": trial.group,
        "label": trial.label,
        "noise": trial.noise,
        "program": program_digest(),
    }
    with tempfile.TemporaryDirectory(dir=out, prefix=".campaign-") as scratch:
        try:
            content |= _examined(trial, Path(scratch))
        except Exception as fault:  # one campaign's fault must not end the test
            content["fault"] = f"{type(fault).__name__}: {fault}"
    write_result(
        out / trial.file, "blind-trial", content, campaign=trial.label, seed=trial.seed,
        elapsed_s=time.perf_counter() - started,
    )  # fmt: skip
    return _line(trial, plain(content))


def _examined(trial: Trial, scratch: Path) -> dict[str, Any]:
    folder, options = _measured(trial, scratch)
    started = time.process_time()  # in this process alone; the clock on the wall tells of other work too
    closure = _closed(folder)
    seconds = time.process_time() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    truth = json.loads(rig.truth_path(folder).read_text(encoding="utf-8"))["undeclared"]
    found = {"truth": truth, "closure": closure, "closing_cpu_s": seconds, "peak_mb": peak}
    return found | {"oracle": _oracle(trial, folder, truth, closure, options)}


def program_digest() -> str:
    """Return a digest of the sources of ``rom`` and ``discovery``: results of one table should share it."""
    import discovery
    import rom

    found = sha256()
    for package in (rom, discovery):
        for path in sorted(Path(str(package.__file__)).parent.rglob("*.py")):
            found.update(path.read_bytes())
    return found.hexdigest()[:12]


def _measured(trial: Trial, scratch: Path) -> tuple[Path, dict[str, Any]]:
    """A campaign that hides the effects; others are drawn where they diverge together."""
    rng = trial.generator()
    for attempt in range(ATTEMPTS):
        effects = tuple(rig.draw(rng, name, enters) for name, enters in trial.hidden)
        options: dict[str, Any] = {
            "cases": PRELOADS, "noise": trial.noise, "seed": int(rng.integers(2**31)), "jobs": 1,
            "duration_s": DURATION_S, "hold_out_every": HOLD_OUT_EVERY,
        }  # fmt: skip
        try:
            return rig.run(scratch / f"campaign-{attempt}", **options, undeclared=effects), options
        except ValueError:
            if attempt + 1 == ATTEMPTS:
                raise
    raise AssertionError


def _closed(folder: Path) -> dict[str, Any]:
    """What `discovery.close_loop` says of a folder, as ``closure.json`` has it, as far as tables need it."""
    import discovery
    from discovery.views.closure_section import closure_section

    closure = closure_section(discovery.close_loop(read_campaign(folder)))
    levels = {
        when: {name: closure["residual"][when].get(name) for name in ("total", COURSES)}
        for when in ("before", "after")
    }
    return {
        "verdict": closure["verdict"],
        "effects": closure["effects"],
        "errors": {"hold_out": closure["errors"]["hold_out"]},
        "residual": levels,
    }


def _oracle(
    trial: Trial, folder: Path, truth: Sequence[Any], closure: dict[str, Any], options: dict[str, Any]
) -> dict[str, Any]:
    """Errors of a model that lacks nothing.

    Without effect that is the declared one; effects of the catalogue are put in and refitted; for others it
    is the declared model on a twin, a campaign of the same seed that was measured without them.
    """
    from experiments.studies.blind.oracle import declared_errors, oracle_errors

    started = time.perf_counter()
    try:
        if trial.group == "clean":
            return {"kind": "declared", "hold_out": closure["errors"]["hold_out"]["before"], "seconds": 0.0}
        twin = read_campaign(rig.run(folder.with_name("twin"), **options))
        if trial.group == "outside":
            kind, found = "twin", [declared_errors(twin)]
        else:
            kind, found = "refitted", oracle_errors(read_campaign(folder), twin, truth)
    except Exception as fault:  # the closure stands without its measure
        return {"fault": f"{type(fault).__name__}: {fault}", "hold_out": None}
    told = dict(zip(("hold_out", "true_values"), (dict(one["hold_out"]) for one in found), strict=False))
    return {"kind": kind, **told, "seconds": time.perf_counter() - started}


def _line(trial: Trial, content: dict[str, Any]) -> str:
    if "fault" in content:
        return f"{trial.label}, seed {trial.seed}: {content['fault']}"
    closure = content["closure"]
    found = ", ".join(f"{one['name']}@{one['enters']}" for one in closure["effects"]) or "nothing"
    cpu_s = content["closing_cpu_s"]
    return f"{trial.label}, seed {trial.seed}: {closure['verdict']}, {found}, {cpu_s:.0f} CPU-s"


def missing(trials: Iterable[Trial], out: Path) -> list[Trial]:
    """Return the trials that have no result yet, or only a fault."""
    return [trial for trial in trials if not _is_done(out / trial.file)]


def _is_done(path: Path) -> bool:
    return path.exists() and "fault" not in json.loads(path.read_text(encoding="utf-8"))


def run(
    trials: Iterable[Trial], out: Path, jobs: int = 1, tell: Callable[[str], None] = lambda _: None
) -> None:
    """Run the trials that have no result in a folder yet.

    Each has a process of its own, so that the peak of its memory is its own.

    Parameters
    ----------
    trials : iterable of Trial
        See `planned`.
    out : Path
        Folder for results.
    jobs : int
        Campaigns at the same time; each takes more than a gigabyte.
    tell : callable
        Called with a line for every campaign that is done.
    """
    writable(out).mkdir(parents=True, exist_ok=True)
    due = missing(trials, out)
    with ProcessPoolExecutor(jobs, get_context("spawn"), max_tasks_per_child=1) as pool:
        pending = [pool.submit(run_trial, trial, out) for trial in due]
        try:
            for number, one in enumerate(as_completed(pending), 1):
                tell(f"{number} of {len(due)}: {one.result()}")
        except BaseException:  # stopped, or a process died: what has not begun is left to the next run
            pool.shutdown(wait=False, cancel_futures=True)
            raise
