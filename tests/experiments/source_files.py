"""Files as others write them: small twins of the public sets, and a laboratory's exports of known signals."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt
from scipy.io import savemat

FloatArray = npt.NDArray[np.float64]
Signals = Mapping[str, tuple[FloatArray, str, float]]  # samples, unit, rate [Hz] by name


def write_emps(folder: Path, samples: int = 400) -> dict[str, dict[str, Any]]:
    """Write both files of EMPS and return their variables."""
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(1)
    files = {}
    for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"):
        jitter = 2e-8 * random.standard_normal(samples)
        files[name] = {
            "t": (np.arange(samples) * 1e-3 + jitter)[:, None],
            "qm": random.standard_normal((samples, 1)),
            "vir": random.standard_normal((samples, 1)),
            "gtau": np.array([[35.15]]),
            "pulses_N": np.zeros((samples, 1), np.uint8),
        }
        savemat(folder / name, files[name])
    return files


def silverbox_drive(lengths: list[int], rests: list[int], seed: int = 2) -> tuple[FloatArray, list[int]]:
    """Return a drive with a growing arrow and multisines after rests, and where each of them starts."""
    random = np.random.default_rng(seed)
    arrow = np.linspace(0, 0.15, 40_000) * random.standard_normal(40_000)
    parts, starts, at = [arrow], [], len(arrow)
    for length, rest in zip([*lengths, 0], rests, strict=True):
        parts.append(np.zeros(rest))
        at += rest
        starts.append(at)
        phases = random.uniform(0, 2 * np.pi, 60)
        # up to a third of the rate, as the circuit's: slow tones alone can be still for 64 samples
        lines = np.linspace(3, length / 3, 60).round()[:, None] * np.arange(length) / max(length, 1)
        tones = np.sqrt(2 / 60) * np.cos(2 * np.pi * lines + phases[:, None]).sum(axis=0)
        tones[:1] = 1.0  # a first sample that is not still
        parts.append(0.022 * tones)
        at += length
    drive = np.concatenate(parts)
    return drive + 0.006 + 1e-3 * random.uniform(-1, 1, len(drive)), starts[:-1]


def write_silverbox(folder: Path, lengths: list[int], rests: list[int]) -> tuple[FloatArray, list[int]]:
    """Write `SNLS80mV.mat` and return the drive and where its multisines start."""
    folder.mkdir(parents=True, exist_ok=True)
    drive, starts = silverbox_drive(lengths, rests)
    savemat(folder / "SNLS80mV.mat", {"V1": drive[None], "V2": 2 * drive[None], "Ovld1": [[0]]})
    return drive, starts


def write_tribometer(folder: Path, cycles: int = 20, lost: int = 7) -> FloatArray:
    """Write `test_data_2.txt` with a stretch at half the rate at first; return its columns."""
    folder.mkdir(parents=True, exist_ok=True)
    steps = np.concatenate([np.full(lost, 0.01), np.full(100 * cycles - 1, 0.005)])
    time = np.concatenate([[0.0], np.cumsum(steps)])
    angle = 4 * np.pi * time
    position = -110.0355 + 0.12 * (1 - np.cos(angle))
    friction = -1.5e6 * np.tanh(5 * np.sin(angle))
    table = np.stack([time, np.full_like(time, 5e6), position, friction], axis=1)
    lines = ["Time [s]\tNormal [uN]\tPosition [mm]\tFriction [uN]"]
    lines += ["\t".join(f"{value:.10g}" for value in row) for row in table]
    (folder / "test_data_2.txt").write_text("\n".join(lines) + "\n")
    return table


def catman_bytes(signals: Signals, precision: int = 8) -> bytes:
    """Return a catman file (version 5012) with a time channel for every rate.

    Laid out as HBM's header of catman's binary export lists it, and as its sample files are read: in the
    extended header of a channel three bytes of padding follow the flag of write protection.
    """
    channels = [(name, *signal) for name, signal in signals.items()]
    for rate in dict.fromkeys(rate for _, _, _, rate in channels):
        length = next(len(samples) for _, samples, _, own in channels if own == rate)
        channels.append((f"Time  {rate:g} Hz", np.arange(length) / rate, "s", rate))
    heads = b"".join(_catman_head(number, *c, precision) for number, c in enumerate(channels))
    front = _text("a comment") + 32 * _text("") + struct.pack("<hi", len(channels), 0)
    front += struct.pack("<i", 0) * len(channels) + struct.pack("<i", 0)
    data = b"".join(_catman_data(samples, precision) for _, samples, _, _ in channels)
    return struct.pack("<hi", 5012, 6 + len(front) + len(heads)) + front + heads + data


def _text(text: str) -> bytes:
    encoded = text.encode()
    return struct.pack("<h", len(encoded)) + encoded


def _catman_head(
    number: int, name: str, samples: FloatArray, unit: str, rate: float, precision: int
) -> bytes:
    export = {8: 0, 4: 1, 2: 2}[precision]
    extended = struct.pack("<dd4h7f", 45000.0, 1e3 / rate, *[0] * 4, *[0.0] * 7)
    extended += struct.pack("<32s8s8s4h2f3h2bf", b"", unit.encode(), b"", *[0] * 4, 0.0, 0.0, *[0] * 5, 0.0)
    extended += struct.pack("<b3x2fb7x", 0, 0.0, 0.0, export)
    head = struct.pack("<hi", number, len(samples)) + _text(name) + _text(unit) + _text("")
    head += struct.pack("<hhdi", 0, 8, 45000.0, len(extended)) + extended
    return head + b"0" + b"0" + struct.pack("<bh", 0, 0) + _text("") + struct.pack("<i", 0)


def _catman_data(samples: FloatArray, precision: int) -> bytes:
    if precision != 2:
        return samples.astype(f"<f{precision}").tobytes()
    low, high = float(samples.min()), float(samples.max())
    counts = np.round((samples - low) / (high - low) * 32767).astype("<u2")
    return struct.pack("<dd", low, high) + counts.tobytes()


def write_catman(path: Path, signals: Signals) -> None:
    """Write a catman file of 8-byte numbers."""
    path.write_bytes(catman_bytes(signals))


def write_matlab(path: Path, signals: Signals) -> None:
    """Write a variable per signal and a time per rate; names become what MATLAB allows."""
    rates = {rate for _, _, rate in signals.values()}
    variables: dict[str, Any] = {name: samples[:, None] for name, (samples, _, _) in signals.items()}
    for rate in rates:
        length = next(len(samples) for samples, _, own in signals.values() if own == rate)
        variables[f"time_{rate:g}"] = np.arange(length)[:, None] / rate
    savemat(path, variables)


def write_matlab_export(path: Path, signals: Signals) -> None:
    """Write the variables of HBK's export, with a time channel for every rate."""
    channels = [(name, *signal) for name, signal in signals.items()]
    for rate in dict.fromkeys(rate for _, _, _, rate in channels):
        length = next(len(samples) for _, samples, _, own in channels if own == rate)
        channels.append((f"Time  {rate:g} Hz", np.arange(length) / rate, "s", rate))
    variables: dict[str, Any] = {"File_Header": {"SampleFrequency": "19200 4800", "Comment": "none"}}
    for number, (name, samples, unit, _) in enumerate(channels, start=1):
        variables[f"Channel_{number}_Header"] = {"SignalName": name, "Unit": unit}
        variables[f"Channel_{number}_Data"] = samples[:, None]
    savemat(path, variables)


def write_matlab_73(path: Path, signals: Signals) -> None:
    """Write a version 7.3 file: HDF5 behind a block of 512 bytes that says so."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, (samples, _, rate) in signals.items():
            for variable, values in ((name, samples[None]), (f"rate_hz_{name}", np.array([[rate]]))):
                file.create_dataset(variable, data=values).attrs["MATLAB_class"] = np.bytes_(b"double")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def write_uff(path: Path, signals: Signals, binary: int = 0) -> None:
    """Write a function of time per signal, in text or binary."""
    import pyuff

    for number, (name, (samples, unit, rate)) in enumerate(signals.items(), start=1):
        function = pyuff.prepare_58(
            binary=binary, func_type=1, rsp_node=number, rsp_dir=3, ref_node=1, ref_dir=3, data=samples,
            x=np.arange(len(samples)) / rate, id1=name, abscissa_spacing=1, abscissa_min=0.0,
            abscissa_inc=1 / rate, abscissa_spec_data_type=17, ordinate_spec_data_type=12,
            ordinate_axis_units_lab=unit, orddenom_spec_data_type=0, num_pts=len(samples), ord_data_type=4,
        )  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)  # the package leaves its file to the collector
            pyuff.UFF(str(path)).write_sets([function], "add")


def write_uff_binary(path: Path, signals: Signals) -> None:
    """Write the functions in binary."""
    write_uff(path, signals, binary=1)


def write_tdms(path: Path, signals: Signals) -> None:
    """Write a channel per signal with the properties of a waveform."""
    import nptdms

    channels = [
        nptdms.ChannelObject("run", name, samples, {"wf_increment": 1 / rate, "unit_string": unit})
        for name, (samples, unit, rate) in signals.items()
    ]
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment(channels)
