"""The field's public benchmarks: their data as campaigns, their official test records, what was published.

Published numbers are RMS errors of simulations from the force alone, by whoever is named; a number that could
not be found in print is not here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

from benchmarks import bouc_wen, one_body
from benchmarks.matlab_rows import rows
from experiments.datasets import emps, silverbox
from experiments.datasets.collected import Collected, SourceError, file_of, optional
from experiments.datasets.vectors import same_length
from rom.campaign.campaign import FORMAT, CampaignSettings
from rom.campaign.channels import Channel
from rom.campaign.record import in_a_line

CHAMPNEYS, NOEL = "Champneys et al. 2024", "Noël et al. 2016"
SOURCES: Mapping[str, str] = {
    CHAMPNEYS: "M.D. Champneys, G.I. Beintema, R. Tóth, M. Schoukens, T.J. Rogers, Baseline results for "
    "selected nonlinear system identification benchmarks, 2024, arXiv 2405.10779",
    NOEL: "J.P. Noël, A.F. Esfahani, G. Kerschen, J. Schoukens, A nonlinear state-space approach to "
    "hysteresis identification, 2016, arXiv 1610.09138",
}
F16_FILES = {
    f"records/level_{level}.h5": f"F16Data_FullMSine_Level{level}{'' if level % 2 else '_Validation'}.mat"
    for level in range(1, 8)
}
F16_SENSORS, F16_BAND_HZ = ("exc", "wing", "payload"), (2.5, 15.0)
SAMPLES_OF_SILVERBOX_MULTISINES = (40_650, 127_400)  # of the file, in the official loader
_TRAINING_SHARE = 0.75  # of these, in the official loader
_STATE = 50  # samples that tell a state, in the official loader


@dataclass(frozen=True)
class Published:
    """An error in print, in the benchmark's unit, by which model and in which of `SOURCES`."""

    error: float
    model: str
    source: str


@dataclass(frozen=True)
class Scored:
    """A test: samples of held-out records, whose errors count together, and the best of what is in print."""

    name: str
    parts: tuple[tuple[str, slice], ...]
    published: Published | None = None


@dataclass(frozen=True)
class Benchmark:
    """A benchmark: how its files are found or fetched, the campaign that they become, and its tests.

    Attributes
    ----------
    title : str
        What it is.
    files : tuple of str
        Files by which it is known in a folder.
    unit, per_si : str, float
        Of its errors, and how many of it one SI unit is.
    collect : callable
        From a folder with its files, or None, and a seed.
    tests : callable
        From a folder with its files, or None.
    loader : str
        Function of the package nonlinear-benchmarks that fetches the files.
    needs_files : bool
        Whether there is no campaign without them.
    remark : str
        What to know of the comparison.
    """

    title: str
    files: tuple[str, ...]
    unit: str
    per_si: float
    collect: Callable[[Path | None, int], Collected]
    tests: Callable[[Path | None], tuple[Scored, ...]]
    loader: str
    needs_files: bool = True
    remark: str = ""

    def source(self, folders: Sequence[Path]) -> Path | None:
        """Return the first folder that has all files somewhere below it."""
        return next((folder for folder in folders if not self.missing([folder])), None)

    def missing(self, folders: Sequence[Path]) -> str:
        """Return the first file that none of these folders has; empty where all files are there."""
        return next((name for name in self.files if not any(_has(folder, name) for folder in folders)), "")

    def fetched(self, folder: Path) -> Path:
        """Have the files downloaded to a folder by their official loader, and return it.

        Raises
        ------
        SourceError
            If the loader is not installed, or does not get all files.
        """
        package = optional("nonlinear_benchmarks", "datasets")
        module, _, name = self.loader.rpartition(".")
        load = getattr(import_module(f"{package.__name__}.{module}") if module else package, name)
        try:
            load(data_file_locations=True, dir_placement=str(folder))
        except Exception as cause:  # network, archive, disk: each means that there are no files
            raise SourceError(f"{self.title} could not be fetched ({in_a_line(cause)})") from None
        if left_out := self.missing([folder]):
            raise SourceError(f"{self.title}: its loader left no {left_out}")
        return folder


def _has(folder: Path, name: str) -> bool:
    try:
        return bool(file_of(folder, name))
    except SourceError:
        return False


def _whole(file: str, first: int = 0) -> tuple[tuple[str, slice], ...]:
    return ((file, slice(first, None)),)


def _emps(folder: Path | None, _seed: int) -> Collected:
    assert folder is not None
    return emps.collect(folder)


def _emps_tests(_folder: Path | None) -> tuple[Scored, ...]:
    best = Published(5.17, "polynomial NARX", CHAMPNEYS)
    return (Scored("pulses", _whole("records/emps_pulses.h5", 20), best),)


def _silverbox(folder: Path | None, _seed: int) -> Collected:
    """The campaign with all multisines held out that reach into the official test samples."""
    assert folder is not None
    made, tests = silverbox.collect(folder), _silverbox_tests(folder)
    held = {file for test in tests for file, _ in test.parts}
    records = tuple(
        record.model_copy(update={"hold_out": record.file in held}) for record in made.settings.record
    )
    return replace(made, settings=made.settings.model_copy(update={"record": records}))


def _silverbox_tests(folder: Path | None) -> tuple[Scored, ...]:
    assert folder is not None
    path = file_of(folder, silverbox.FILE)
    start, stop = SAMPLES_OF_SILVERBOX_MULTISINES
    first = start + int(_TRAINING_SHARE * (stop - start)) + _STATE
    parts = tuple(
        (f"records/multisine_{number:02d}.h5", slice(max(first - part.start, 0), stop - part.start))
        for number, part in enumerate(silverbox.multisines(path.name, rows(path, "V1", 1)[0]), 1)
        if part.stop > first
    )
    arrow = "records/arrow.h5"
    return (
        Scored("multisines", parts, Published(0.301, "Gaussian process NARX (GRU: 1.49)", CHAMPNEYS)),
        Scored(
            "arrow", ((arrow, slice(100 + _STATE, None)),),
            Published(0.60, "Gaussian process NARX (GRU: 2.80)", CHAMPNEYS),
        ),
        Scored(
            "arrow, without extrapolation", ((arrow, slice(100 + _STATE, 32_100)),),
            Published(0.259, "Gaussian process NARX (GRU: 0.947)", CHAMPNEYS),
        ),
    )  # fmt: skip


def _bouc_wen_tests(_folder: Path | None) -> tuple[Scored, ...]:
    best = Published(12.1, "polynomial state space of 217 numbers", NOEL)
    multisine = _whole(bouc_wen.TESTS["multisine"], bouc_wen.PERIOD * (bouc_wen.PERIODS - 1))
    return (
        Scored("multisine, steady", multisine, best),
        Scored("sine sweep", _whole(bouc_wen.TESTS["sinesweep"])),
    )


def _tanks(folder: Path | None, _seed: int) -> Collected:
    """Two tanks, one over the other: a pump's voltage and a level, taken as N and m."""
    assert folder is not None
    path = file_of(folder, "dataBenchmark.mat")
    names = ("uEst", "yEst", "uVal", "yVal")
    vectors = {name: rows(path, name, 1)[0] for name in names}
    rate_hz = 1 / float(rows(path, "Ts", 1)[0, 0])
    files = {"records/estimation.h5": "Est", "records/validation.h5": "Val"}
    name = "Cascaded tanks; volts taken as N and m"
    settings = one_body.settings(name, "level", "outflow", rate_hz, tuple(files), ("records/validation.h5",))

    def records() -> Iterator[tuple[str, Mapping[str, Channel]]]:
        for file, kind in files.items():
            same_length(path, {name: vectors[name] for name in (f"u{kind}", f"y{kind}")})
            yield file, one_body.channels("level", vectors[f"u{kind}"], vectors[f"y{kind}"], rate_hz)

    return Collected(settings, records())


def _tanks_tests(_folder: Path | None) -> tuple[Scored, ...]:
    best = Published(0.191, "grey box, Worden et al. 2018 (GRU: 0.396)", CHAMPNEYS)
    return (Scored("validation", _whole("records/validation.h5", _STATE), best),)


def _f16(folder: Path | None, _seed: int) -> Collected:
    """A wing with a payload: accelerations at the shaker and on both sides of the joint between the two."""
    assert folder is not None
    paths = {file: file_of(folder, name) for file, name in F16_FILES.items()}
    first = next(iter(paths.values()))
    rate_hz = float(rows(first, "Fs", 1)[0, 0])
    settings = CampaignSettings.model_validate(
        {
            "format": FORMAT,
            "name": "F-16, right wing and payload (Noël, Schoukens 2017)",
            "modes": {"count": len(F16_SENSORS)},
            "sampling": {"motion_rate_hz": rate_hz, "tension_rate_hz": rate_hz, "pretrigger_s": 0.0},
            "band": dict(zip(("low_hz", "high_hz"), F16_BAND_HZ, strict=True)),
            "record": [
                {"file": file, "test": "driven", "hold_out": "Valid" in path.name}
                for file, path in paths.items()
            ],
        }
    )

    def records() -> Iterator[tuple[str, Mapping[str, Channel]]]:
        for file, path in paths.items():
            accelerations = rows(path, "Acceleration", len(F16_SENSORS))
            shown = {"force_exc": rows(path, "Force", 1)[0]}
            shown |= {f"acceleration_{b}": a for b, a in zip(F16_SENSORS, accelerations, strict=True)}
            same_length(path, shown)
            yield file, {name: Channel(name, samples, rate_hz) for name, samples in shown.items()}

    return Collected(settings, records())


def _f16_tests(_folder: Path | None) -> tuple[Scored, ...]:
    tests = (file for file, name in F16_FILES.items() if "Valid" in name)
    return tuple(Scored(Path(file).stem, _whole(file, _STATE)) for file in tests)


BENCHMARKS: Mapping[str, Benchmark] = {
    "emps": Benchmark(
        "EMPS: a carriage on a guide", tuple(emps.FILES.values()), "mm", 1e3, _emps, _emps_tests, "EMPS",
        remark="dynoNet (Forgione, Piga 2021) is cited with 0.452 mm; the script published with it simulates "
        "the record for estimation.",
    ),
    "silverbox": Benchmark(
        "Silverbox: a circuit like a mass on a hardening spring", (silverbox.FILE,), "mV", 1e3, _silverbox,
        _silverbox_tests, "Silverbox",
        remark="Trained on the multisines that lie within the official training samples as a whole.",
    ),
    "bouc-wen": Benchmark(
        "Bouc-Wen: a mass on a hysteretic spring",
        tuple(f"{kind}val_{name}.mat" for kind in "uy" for name in bouc_wen.TESTS), "µm", 1e6,
        bouc_wen.collect, _bouc_wen_tests, "not_splitted_benchmarks.BoucWen", needs_files=False,
        remark=f"Noise of the training records: {bouc_wen.NOISE_RMS_M * 1e6:g} µm; test records have none.",
    ),
    "cascaded-tanks": Benchmark(
        "Cascaded tanks: no structure, no effect of the catalogue", ("dataBenchmark.mat",), "V", 1.0, _tanks,
        _tanks_tests, "Cascaded_Tanks",
        remark="A negative: the law of an outflow is none of the catalogue, and a name would be wrong.",
    ),
    "f-16": Benchmark(
        "F-16: a wing with a payload, three accelerometers", tuple(F16_FILES.values()), "m/s2", 1.0, _f16,
        _f16_tests, "F16",
        remark="RMS over all accelerations. Of many modes three are declared, as many as sensors, in a band.",
    ),
}  # fmt: skip
