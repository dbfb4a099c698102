from __future__ import annotations

import errno
import os
import pickle
import struct
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.io import savemat

from rom.campaign.channels import LARGEST, SMALLEST, channel_names, default_rate, nearest
from rom.campaign.formats import READERS
from rom.campaign.record import Channel, RecordError, read_channels, write_channels

FINITE = hnp.arrays(np.float64, 12, elements=st.floats(-LARGEST, LARGEST)).filter(
    lambda samples: all(
        not samples[::step].any() or np.abs(samples[::step]).max() >= SMALLEST for step in (1, 4)
    )
)


def _read(path: Path) -> dict[str, Channel]:
    return read_channels(path, motion_rate_hz=400, tension_rate_hz=100)


def _csv(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines))
    return path


class TestChannel:
    def test_time_and_duration(self) -> None:
        channel = Channel("force_lo", np.zeros(8), 4.0)
        assert channel.duration_s == 2.0
        np.testing.assert_array_equal(channel.time, np.arange(8) / 4)

    @pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
    def test_a_rate_must_be_above_zero(self, rate: float) -> None:
        with pytest.raises(ValueError, match="rate_hz must be above 0"):
            Channel("force_lo", np.zeros(8), rate)

    def test_samples_must_be_one_column(self) -> None:
        with pytest.raises(ValueError, match=r"one-dimensional, instead got shape \(2, 4\)"):
            Channel("force_lo", np.zeros((2, 4)), 1.0)


def test_names_rates_and_slips() -> None:
    names = channel_names(["lo"], ["joint"])
    assert names == (
        "force_lo",
        "acceleration_lo",
        "velocity_lo",
        "displacement_lo",
        "link_displacement_joint",
        "link_force_joint",
        "normal_force_joint",
        "tension",
        "strain",
        "acceleration_ground",
        "displacement_ground",
    )
    assert [default_rate(name, 400, 100) for name in ("force_lo", "link_force_joint", "strain")] == [
        400,
        400,
        100,
    ]
    assert nearest("Aceleration_LO", names) == "acceleration_lo"
    assert nearest("zzz", names) is None


@pytest.mark.parametrize("ending", [".h5", ".mat", ".csv", ".H5"])
@given(fast=FINITE)
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read(ending: str, fast: np.ndarray, tmp_path: Path) -> None:
    channels = {"force_lo": Channel("force_lo", fast, 300.0), "strain": Channel("strain", fast[::4], 75.0)}
    path = tmp_path / f"record{ending}"
    write_channels(path, channels)
    found = _read(path)
    assert found.keys() == channels.keys()
    for name, channel in channels.items():
        assert found[name].rate_hz == pytest.approx(channel.rate_hz, rel=1e-9)
        np.testing.assert_allclose(found[name].samples, channel.samples, rtol=1e-14)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("dtype", ["i2", "u1", "i8", "f4", "f8"])
@pytest.mark.parametrize("shape", [(40,), (40, 1), (1, 40)])
def test_every_number_type_and_either_orientation(dtype: str, shape: tuple[int, ...], tmp_path: Path) -> None:
    samples = np.arange(40).astype(dtype).reshape(shape)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["force_lo"] = samples
    with h5py.File(tmp_path / "b.mat", "w", userblock_size=512) as file:
        file["force_lo"] = samples
        file["force_lo"].attrs["MATLAB_class"] = np.bytes_("double")
        file["rate_hz_force_lo"] = [[50.0]]
        file.create_group("#refs#")
    savemat(tmp_path / "c.mat", {"force_lo": samples, "rate_hz_force_lo": np.uint16(50)})
    for name, rate in (("a.h5", 400), ("b.mat", 50), ("c.mat", 50)):
        (channel,) = _read(tmp_path / name).values()
        assert channel.rate_hz == rate
        assert channel.samples.dtype == np.float64
        np.testing.assert_array_equal(channel.samples, np.arange(40))


def test_a_matlab_hdf5_file_of_text_and_nothing_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file["strain"] = np.array([104, 105], dtype=np.uint16)
        file["strain"].attrs["MATLAB_class"] = "char"
        file["force_lo"] = np.array([0, 0], dtype=np.uint64)
        file["force_lo"].attrs["MATLAB_empty"] = np.uint8(1)
        file["tension"] = np.ones(3, dtype=[("real", "f8"), ("imag", "f8")])
        file["velocity_lo"] = h5py.SoftLink("/nowhere")
    with pytest.raises(RecordError) as refusal:
        _read(tmp_path / "a.mat")
    assert refusal.value.faults == (
        "force_lo: found no samples, expected a signal",
        "strain: found a MATLAB char variable, expected real numbers",
        "tension: found complex numbers, expected real numbers",
        "velocity_lo: found a link to other data, expected a data set in this file",
    )


def test_h5_rate_attribute_overrides_and_rounding_does_not(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, rate in (("force_lo", 800), ("velocity_lo", 400.0001), ("strain", np.array([50]))):
            file[name] = np.zeros(8 * round(float(np.squeeze(rate)) / 50))
            file[name].attrs["rate_hz"] = rate
    rates = {name: channel.rate_hz for name, channel in _read(tmp_path / "a.h5").items()}
    assert rates == {"force_lo": 800, "velocity_lo": 400, "strain": 50}


class TestCsv:
    def test_empty_cells_make_a_slower_channel(self, tmp_path: Path) -> None:
        rows = [f"{0.005 * i:.3f}, {i}, {i // 4 if i % 4 == 0 else ''}" for i in range(20)]
        found = _read(_csv(tmp_path / "a.csv", "\ufefftime_s, force_lo , tension", *rows, ""))
        assert found["force_lo"].rate_hz == pytest.approx(200)
        assert found["tension"].rate_hz == pytest.approx(50)
        np.testing.assert_array_equal(found["tension"].samples, np.arange(5))

    def test_rates_that_do_not_divide_share_a_grid(self, tmp_path: Path) -> None:
        slow = {round(i * 1000 / 260) for i in range(27)}
        rows = [f"{i / 1000:.4f},{i},{i if i in slow else ''}" for i in range(100)]
        found = _read(_csv(tmp_path / "a.csv", "time_s,force_lo,tension", *rows))
        assert found["tension"].rate_hz == pytest.approx(260, rel=0.01)
        assert len(found["tension"].samples) == 26

    def test_printed_times_need_few_digits(self, tmp_path: Path) -> None:
        rows = [f"{i / 19200:.5f},{i}" for i in range(4000)]
        (channel,) = read_channels(_csv(tmp_path / "a.csv", "time_s,force_lo", *rows), 19200, 4800).values()
        assert channel.rate_hz == 19200

    def test_time_may_start_anywhere(self, tmp_path: Path) -> None:
        rows = [f"{12 + i / 400},{i},{-i}" for i in range(40)]
        found = _read(_csv(tmp_path / "a.csv", "time_s,force_lo,acceleration_lo", *rows))
        assert {channel.rate_hz for channel in found.values()} == {400}

    @pytest.mark.parametrize(
        ("rows", "words"),
        [
            (["0,1,", "1,2,", "2,3,5", "3,4,"], "tension: found 1 filled cells"),
            (
                ["0,1,", "1,2,5", "2,3,5", "3,4,5"],
                "tension: found the first number at 1 s, expected it at 0 s",
            ),
            (["0,1,2"], "time_s: found 1 rows"),
            (["0,1,2", "1,3,4", "2.9,1,1", "3,1,1"], "time_s: found a step of 1.9 s at 1 s"),
            (["0,1,2", "1,3,4", "0.5,1,1"], "time_s: found 0.5 after 1"),
            (["0,1,2,3", "1,3,4,5"], "file: found 4 cells a row, expected 3"),
            (["0;1;2", "1;3;4"], "file: found 1 cells a row, expected 3"),
            ([], "file: found it unreadable"),
        ],
    )
    def test_what_cannot_be_is_refused(self, rows: list[str], words: str, tmp_path: Path) -> None:
        path = _csv(tmp_path / "a.csv", "time_s,force_lo,tension", *rows)
        with pytest.raises(RecordError) as refusal:
            _read(path)
        (line,) = refusal.value.faults
        assert line.startswith(words)

    @pytest.mark.parametrize("suffix", [".h5", ".mat", ".csv"])
    def test_a_fault_of_the_system_is_said_in_words(
        self, suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Of a file that may not be read, its libraries' numbers, flags and names say nothing to people."""
        (tmp_path / f"a{suffix}").write_bytes(b"x")

        def denied(_: Path) -> None:
            raise PermissionError(errno.EACCES, "unable to open file: errno = 13, flags = 0")

        monkeypatch.setitem(READERS, suffix, denied)
        with pytest.raises(RecordError) as refusal:
            _read(tmp_path / f"a{suffix}")
        (line,) = refusal.value.faults
        assert line.endswith(f"({os.strerror(errno.EACCES)})")

    def test_rates_that_do_not_divide_are_not_written(self, tmp_path: Path) -> None:
        channels = {name: Channel(name, np.zeros(9), rate) for name, rate in (("a", 30.0), ("b", 20.0))}
        with pytest.raises(ValueError, match="whole fraction of 30 Hz"):
            write_channels(tmp_path / "a.csv", channels)
        assert list(tmp_path.iterdir()) == []


class TestLengths:
    @pytest.mark.parametrize(
        ("force", "acceleration", "strain", "faulty"),
        [
            (400, 400, 100, ()),
            (401, 401, 100, ()),
            (399, 399, 100, ()),
            (400, 400, 101, ()),
            (400, 399, 100, ("acceleration_lo",)),
            (400, 400, 98, ("strain",)),
            (360, 360, 100, ("strain",)),
        ],
    )
    def test_equal_at_one_rate_and_within_a_slow_sample_between_rates(
        self, force: int, acceleration: int, strain: int, faulty: tuple[str, ...], tmp_path: Path
    ) -> None:
        lengths = {"force_lo": force, "acceleration_lo": acceleration, "strain": strain}
        savemat(tmp_path / "a.mat", {name: np.zeros(length) for name, length in lengths.items()})
        if not faulty:
            assert len(_read(tmp_path / "a.mat")) == 3
            return
        with pytest.raises(RecordError) as refusal:
            _read(tmp_path / "a.mat")
        assert tuple(line.split(":")[0] for line in refusal.value.faults) == faulty


@pytest.mark.parametrize("size", [1e308, 1e41, 1e-41, 5e-324])
def test_samples_whose_powers_are_no_numbers_are_refused(size: float, tmp_path: Path) -> None:
    """Their squares are infinite or zero: fits ended in a traceback."""
    write_channels(tmp_path / "a.h5", {"force_lo": Channel("force_lo", np.full(40, -size), 400.0)})
    with pytest.raises(RecordError, match=r"force_lo: found samples of .* from 1e-40 to 1e\+40"):
        _read(tmp_path / "a.h5")


def test_a_letter_that_is_no_number_is_a_fault_without_a_warning(tmp_path: Path) -> None:
    letters = np.array([97.0, 98.0, np.nan, -1.0])  # text of MATLAB 4 may be held in floats
    head = struct.pack("<5i", 1, 1, len(letters), 0, 9) + b"force_lo\0"
    (tmp_path / "a.mat").write_bytes(head + letters.tobytes())
    with pytest.raises(RecordError, match="force_lo: found text"):
        _read(tmp_path / "a.mat")


def test_several_nan_are_one_fault(tmp_path: Path) -> None:
    write_channels(
        tmp_path / "a.h5", {"force_lo": Channel("force_lo", np.r_[0, np.nan, 0, np.inf, 0], 400.0)}
    )
    with pytest.raises(RecordError, match=r"nan at sample 1 \(0.0025 s\) and 1 more") as refusal:
        _read(tmp_path / "a.h5")
    copy = pickle.loads(pickle.dumps(refusal.value))
    assert copy.faults == refusal.value.faults


def test_samples_in_another_file_are_refused(tmp_path: Path) -> None:
    np.zeros(10).tofile(tmp_path / "raw.bin")
    layout = h5py.VirtualLayout((10,), "f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "force_lo", shape=(10,))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("force_lo", (10,), "f8", external=[(str(tmp_path / "raw.bin"), 0, 80)])
        file.create_virtual_dataset("velocity_lo", layout)
    with pytest.raises(RecordError) as refusal:
        _read(tmp_path / "a.h5")
    assert len(refusal.value.faults) == 2
    assert all("another file" in line for line in refusal.value.faults)


@pytest.mark.parametrize("path", ["a.xlsx", "a", "folder.csv", "missing.h5", "missing.mat", "missing.csv"])
def test_files_that_cannot_be_records(path: str, tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(RecordError, match=r"file: found .* expected"):
        _read(tmp_path / path)


def test_other_endings_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r'ending "\.npy", expected \.h5'):
        write_channels(tmp_path / "a.npy", {})


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    write_channels(path, {"force_lo": Channel("force_lo", np.ones(40), 400.0)})
    with pytest.raises((ValueError, TypeError, AttributeError)):
        write_channels(path, {"force_lo": None})  # type: ignore[dict-item]
    assert _read(path)["force_lo"].samples.sum() == 40
    assert [file.name for file in tmp_path.iterdir()] == ["a.h5"]
