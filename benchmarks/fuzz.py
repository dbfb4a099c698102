"""Damaged inputs to every reader and command: ``python -m benchmarks.fuzz``.

Whatever comes in, a command ends with 0, 2 or 3 within its time; what is refused is told in lines that can be
printed, and then nothing is written; result files are strict JSON; no traceback, no warning of a library, no
scratch file is left; inputs stay as they are. Every input runs the program in a process of its own, from its
seed and number alone:

    python -m benchmarks.fuzz --inputs 5000 --seed 1
    python -m benchmarks.fuzz --seed 1 --only 4711      # one of them again, its folder kept
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.fuzz_inputs import Input, imported, input_of, sound_inputs
from experiments.cli import run
from experiments.errors import show_warnings_plainly

LONGEST_S = 120.0
LONGEST_LINE = 700
CODES = (0, 2, 3)
SIGNS = ("Traceback", "Warning", "warning:", "Exception ignored", "fault of the program")


@dataclass(frozen=True)
class Ended:
    """How a run ended: its code (negative: the signal that ended it), what it said, and the time it took."""

    code: int
    out: str
    err: str
    seconds: float


def ran(arguments: Sequence[str], folder: Path, longest_s: float = LONGEST_S) -> Ended:
    """Run the program in a child of this process, which has all imports; what it starts ends with it.

    Parameters
    ----------
    arguments : sequence of str
        Of the program.
    folder : Path
        Where it runs.
    longest_s : float
        After that it is killed [s].

    Returns
    -------
    Ended
        How it ended.
    """
    started = time.monotonic()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if child == 0:
            _run_here(arguments, folder, out.fileno(), err.fileno())
        status = _waited(child, started + longest_s)
        texts = []
        for stream in (out, err):
            stream.seek(0)
            texts.append(stream.read().decode(errors="replace"))
    return Ended(os.waitstatus_to_exitcode(status), *texts, time.monotonic() - started)


def _run_here(arguments: Sequence[str], folder: Path, out: int, err: int) -> None:
    code = 1
    try:
        os.setsid()
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(out, 1)
        os.dup2(err, 2)
        sys.stdout, sys.stderr = (os.fdopen(number, "w", closefd=False) for number in (1, 2))
        os.chdir(folder)
        show_warnings_plainly()
        code = run(list(arguments))
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _waited(child: int, until: float) -> int:
    while time.monotonic() < until:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        time.sleep(0.005)
    else:
        os.killpg(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # parsers that it started
    return status


def contents(folder: Path) -> dict[str, str]:
    """Return a digest of every file below a folder, and of every folder its name alone."""
    found = {}
    for path in sorted(folder.rglob("*")):
        plain = path.is_file() and not path.is_symlink()
        found[str(path.relative_to(folder))] = hashlib.sha256(path.read_bytes()).hexdigest() if plain else ""
    return found


def faults(
    ended: Ended,
    before: Mapping[str, str],
    after: Mapping[str, str],
    folder: Path,
    longest_s: float = LONGEST_S,
) -> list[str]:
    """Return what is wrong with a run; nothing where it did as it should.

    Parameters
    ----------
    ended : Ended
        The run.
    before, after : mapping of str to str
        Contents of its folder.
    folder : Path
        The folder itself.
    longest_s : float
        Time that it had [s].
    """
    if ended.seconds > longest_s:
        return [f"no end within {longest_s:g} s"]
    found = []
    if ended.code not in CODES:
        found.append(f"code {ended.code}")
    found += [f'"{sign}" on standard error' for sign in SIGNS if sign in ended.err]
    new = after.keys() - before.keys()
    if ended.code == 2:
        lines = ended.err.splitlines()
        found += [] if lines and all(line.strip() for line in lines) else ["refused without a word"]
        found += ["a line that cannot be printed" for line in lines if not line.isprintable()][:1]
        found += [f"a line of {len(line)} characters" for line in lines if len(line) > LONGEST_LINE][:1]
        found += [f"refused, and yet written: {name}" for name in sorted(new)[:3]]
    changed = [name for name in before if after.get(name) != before[name]]
    found += [f"changed or lost: {name}" for name in changed[:3]]
    found += [f"left over: {name}" for name in sorted(new) if Path(name).name.startswith(".")][:3]
    found += [
        line for name in sorted(new) if name.endswith(".json") and (line := _no_json(folder / name, name))
    ]
    return found


def _no_json(path: Path, name: str) -> str:
    def refuse(token: str) -> None:
        raise ValueError(token)

    try:
        json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    except ValueError as error:
        return f"{name} is no strict JSON: {error}"
    return ""


def judged(one: Input, folder: Path, longest_s: float = LONGEST_S) -> tuple[Ended, list[str]]:
    """Run an input and return how it ended and what is wrong with that."""
    before = contents(folder)
    ended = ran(one.arguments, folder, longest_s)
    return ended, faults(ended, before, contents(folder), folder, longest_s)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, help="one input, its folder kept")
    parser.add_argument("--sound", type=Path, help="folder of sound inputs, kept for the next run")
    parser.add_argument("--kind", default="", help="inputs whose kind begins with this")
    return parser.parse_args()


def main() -> None:
    """Run all inputs; print every failure with its seed and number, then the counts."""
    asked, counts, slowest = _arguments(), Counter[tuple[str, str]](), Counter[str]()
    failed = 0
    with tempfile.TemporaryDirectory() as scratch:
        imported()
        sound = asked.sound or Path(scratch) / "sound"
        if not sound.exists():
            sound_inputs(sound)
        numbers = range(asked.inputs) if asked.only is None else [asked.only]
        for number in numbers:
            folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
            one = input_of(sound, folder, asked.seed, number, asked.kind)
            ended, wrong = judged(one, folder)
            outcome = "failed" if wrong else {0: "done", 2: "refused", 3: "unfit"}[ended.code]
            counts[one.kind, outcome] += 1
            slowest[one.kind] = max(slowest[one.kind], round(ended.seconds))
            if wrong or asked.only is not None:
                failed += bool(wrong)
                print(
                    f"seed {asked.seed} input {number} {one.kind}: {'; '.join(wrong) or outcome}", flush=True
                )
                print(f"    boltlaw {' '.join(one.arguments)}   ({one.damage})")
                print("".join(f"    {line[:300]}\n" for line in ended.err.splitlines()[-12:]), flush=True)
                if asked.only is not None:
                    print(f"{ended.out}\n    in {folder}")
            if asked.only is None:
                shutil.rmtree(folder)
            if (number + 1) % 250 == 0:
                print(f"{number + 1} inputs, {failed} failed", flush=True)
    _tell(counts, slowest)
    sys.exit(1 if failed else 0)


def _tell(counts: Counter[tuple[str, str]], slowest: Counter[str]) -> None:
    table = Table("kind", "done", "refused", "unfit", "failed", "slowest [s]")
    kinds = sorted({kind for kind, _ in counts})
    for kind in kinds:
        table.add_row(
            kind,
            *(str(counts[kind, how]) for how in ("done", "refused", "unfit", "failed")),
            str(slowest[kind]),
        )
    table.add_row(
        "all", *(str(sum(counts[k, how] for k in kinds)) for how in ("done", "refused", "unfit", "failed"))
    )
    Console().print(table)


if __name__ == "__main__":
    main()
