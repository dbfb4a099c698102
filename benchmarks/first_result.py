"""CPU time of the first `boltlaw identify` after an installation, and of the next, on a campaign of the rig.

    python -m benchmarks.first_result --repeats 3

The first compiles its kernels into an empty folder. Beside both stands what a process spends on loading
the libraries alone, since the clocks of machines differ.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

LIBRARIES = "import matplotlib.figure, numba, scipy.optimize, scipy.signal, scipy.stats"
RIG = ("rig", "campaign", "--cases", "10", "--strengths", "1,0.8,0.6", "--duration-s", "3", "--seed", "1")


def cpu_s(arguments: list[str], folder: str, variables: Mapping[str, str]) -> float:
    """Return the CPU time of Python with these arguments and of all processes that it starts [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), **variables}
    subprocess.run([sys.executable, *arguments], cwd=folder, env=environment, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print medians and ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--repeats", type=int, default=3)
    repeats = parser.parse_args().repeats
    spent: dict[str, list[float]] = {"libraries loaded": [], "first identify": [], "next identify": []}
    program = ["-m", "experiments.cli"]
    with TemporaryDirectory() as folder:
        cpu_s([*program, *RIG], folder, {})
        for number in range(repeats):
            kernels = {"NUMBA_CACHE_DIR": f"{folder}/kernels{number}"}
            spent["libraries loaded"].append(cpu_s(["-c", LIBRARIES], folder, {}))
            for name in ("first identify", "next identify"):
                spent[name].append(cpu_s([*program, "identify", "campaign"], folder, kernels))
    libraries = statistics.median(spent["libraries loaded"])
    for name, times in spent.items():
        median = statistics.median(times)
        spread = f"({min(times):.1f} to {max(times):.1f})"
        print(f"{name:17} {median:6.1f} s {spread}, {median / libraries:5.1f} times the libraries")


if __name__ == "__main__":
    main()
