"""MATLAB files without a compiled reader: what SciPy writes comes back, and damage is a message."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from rom.campaign.matlab_arrays import level_of, variables
from rom.campaign.record import inspect_channels

KINDS = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")


def saved(content: dict[str, object], *, packed: bool) -> bytes:
    file = BytesIO()
    savemat(file, content, do_compression=packed)
    return file.getvalue()


@pytest.mark.parametrize("packed", [False, True])
def test_real_arrays_of_every_kind_come_back(tmp_path: Path, packed: bool) -> None:
    arrays: dict[str, object] = {f"x_{kind}": np.arange(6).astype(kind).reshape(2, 3) for kind in KINDS}
    others: dict[str, object] = {
        "text": "abc", "yes": np.array([True]), "s": {"a": 1.0}, "c": np.array([1, "x"], object),
        "z": np.array([1j]), "none": np.zeros((0, 0)), "a_rather_long_name_of_a_channel": 3.0,
    }  # fmt: skip
    path = tmp_path / "a.mat"
    path.write_bytes(saved(arrays | others, packed=packed))
    found = {one.name: one for one in variables(path)}
    assert level_of(path) == 5
    assert list(found) == [*arrays, *others]
    for name, array in arrays.items():
        assert found[name].samples is not None
        np.testing.assert_array_equal(found[name].samples, array)
        assert found[name].samples.dtype == array.dtype  # type: ignore[union-attr,attr-defined]
    told = [found[name].kind for name in ("text", "yes", "s", "c", "z", "none")]
    assert told == ["char", "logical", "struct", "cell", "complex", "numeric"]


@pytest.mark.parametrize("packed", [False, True])
def test_damage_is_a_fault_of_the_record(tmp_path: Path, packed: bool) -> None:
    """SciPy's compiled reader ends the process by the 83rd of such files, for each of four seeds."""
    random, path = np.random.default_rng(0), tmp_path / "a.mat"
    sound = saved({"force_lo": np.zeros(300), "strain": np.zeros(75)}, packed=packed)
    faults = 0
    for count in range(300):
        data = bytearray(sound)
        for place in random.integers(128, min(400, len(data)), 3):
            data[place] = random.integers(256)
        path.write_bytes(data[: random.integers(1, len(data))] if count % 5 == 0 else data)
        faults += bool(inspect_channels(path, 400.0, 100.0).faults)
    assert faults > 100
