"""What parsers of others pass over: MATLAB's objects, padded universal files, scales of TDMS, warnings."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from tests.experiments.datasets.lab_case import (
    CHANNELS,
    HZ,
    N,
    Outcome,
    clock,
    force_and_acceleration,
    imported,
)
from tests.experiments.datasets.matlab_objects import opaque, with_object, with_object_73

FORCE, ACCELERATION = force_and_acceleration()
Put = Callable[..., Outcome]


def sound(found: Outcome, rate_hz: float = HZ, rtol: float = 1e-12, samples: int = N) -> None:
    """Require both channels as written."""
    assert found.code == 0, found.line
    assert found.rates == pytest.approx({"force_m": rate_hz, "acceleration_m": rate_hz}, rel=1e-4)
    np.testing.assert_allclose(found.samples["force_m"], FORCE[:samples], rtol=rtol, atol=rtol)
    np.testing.assert_allclose(found.samples["acceleration_m"], ACCELERATION[:samples], rtol=rtol, atol=rtol)


def refused(found: Outcome, *words: str) -> None:
    """Require one line with these words."""
    assert found.code == 2, found
    assert len(found.line.splitlines()) == 1, found.line
    assert all(word in found.line for word in words), found.line


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """A folder for files."""
    (tmp_path / "lab").mkdir()
    return tmp_path / "lab"


@pytest.fixture
def put(capfd: pytest.CaptureFixture[str], lab: Path) -> Put:
    """Import what was put into the folder, with a map of the names of F and A."""

    def work(form: str, force: str = "F", acceleration: str = "A", **more: str) -> Outcome:
        rules = {force: CHANNELS["F"], acceleration: CHANNELS["A"], **more}
        return imported(capfd, lab, form, rules)

    return work


@pytest.mark.parametrize("write", [with_object, with_object_73])
@pytest.mark.parametrize("kind", ["table", "timetable"])
@pytest.mark.parametrize("name", ["T.F", "T"])
def test_a_table_of_matlab_is_named_with_the_remedy(
    write: Any, kind: str, name: str, lab: Path, put: Put
) -> None:
    write(lab / "a.mat", kind, {"A": ACCELERATION, "t": clock()})
    refused(put("matlab", name), "a.mat: T", "table", "table2struct(T, 'ToScalar', true)")


def test_of_several_tables_each_is_named_with_the_remedy(lab: Path, put: Put) -> None:
    with_object(lab / "a.mat", "table", {"A": ACCELERATION, "t": clock()})
    with (lab / "a.mat").open("ab") as file:
        file.write(opaque("other", "table"))
    refused(put("matlab", "T.F"), "a.mat", "table2struct")


@pytest.mark.parametrize("write", [with_object, with_object_73])
def test_a_table_beside_the_signals_is_not_in_the_way(write: Any, lab: Path, put: Put) -> None:
    write(lab / "a.mat", "table", {"F": FORCE, "A": ACCELERATION, "t": clock()})
    sound(put("matlab"))


def structures() -> Any:
    """Return an array of structures of F, A, t."""
    runs = np.zeros((2,), dtype=[("F", "O"), ("A", "O"), ("t", "O")])
    runs[0] = (2 * FORCE, 2 * ACCELERATION, clock())
    runs[1] = (FORCE, ACCELERATION, clock())
    return runs


def cells() -> Any:
    """Return a cell array of a text, F and A."""
    found = np.empty((3,), dtype=object)
    found[:] = ["rig 3", FORCE, ACCELERATION]
    return found


@pytest.mark.parametrize(
    ("variables", "force", "acceleration"),
    [
        ({"runs": structures()}, "runs(2).F", "runs(2).A"),
        ({"c": cells(), "t": clock()}, "c{2}", "c{3}"),
        ({"run": {"c": cells(), "fs": 25600.0}}, "run.c{2}", "run.c{3}"),
        ({"a": {"b": {"F": FORCE, "A": ACCELERATION, "time": clock()}}}, "a.b.F", "a.b.A"),
        ({"run": {"fs": 25600, "F": FORCE, "A": ACCELERATION}}, "run.F", "run.A"),
    ],
)
def test_structures_and_cells(
    variables: Mapping[str, Any], force: str, acceleration: str, lab: Path, put: Put
) -> None:
    savemat(lab / "a.mat", variables)
    sound(put("matlab", force, acceleration))


@pytest.mark.parametrize(
    ("values", "words"), [(FORCE * 1j, "complex"), (FORCE.reshape(4, 10, -1), "three dimensions")]
)
def test_what_is_no_vector_is_named(values: Any, words: str, lab: Path, put: Put) -> None:
    savemat(lab / "a.mat", {"F": values, "A": ACCELERATION, "t": clock()})
    refused(put("matlab"), "a.mat: F", words)


def function(name: str, samples: Any, **more: Any) -> dict[str, Any]:
    """Return a function of time for pyuff."""
    import pyuff

    fields = {
        "binary": 0,
        "func_type": 1,
        "rsp_node": 1,
        "rsp_dir": 3,
        "ref_node": 1,
        "ref_dir": 3,
        "data": samples,
        "x": clock(len(samples)),
        "id1": name,
        "abscissa_spacing": 1,
        "abscissa_min": 0.0,
        "abscissa_inc": 1 / HZ,
        "abscissa_spec_data_type": 17,
        "ordinate_spec_data_type": 12,
        "orddenom_spec_data_type": 0,
        "abscissa_axis_units_lab": "s",
        "num_pts": len(samples),
        "ord_data_type": 4,
    }
    return dict(pyuff.prepare_58(**{**fields, **more}))


def write_functions(path: Path, count: int = N, **more: Any) -> None:
    """Write F and A; pyuff writes single precision only if it is told so."""
    import pyuff

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        for name, samples in (("F", FORCE), ("A", ACCELERATION)):
            one = function(name, samples[:count], **more)
            pyuff.UFF(str(path)).write_sets([one], "add", force_double=more.get("ord_data_type") != 2)


@cache
def functions(kind: int, spacing: int, count: int = N) -> str:
    """Return the text of a universal file of F and A."""
    with TemporaryDirectory() as folder:
        write_functions(Path(folder) / "a.uff", count, ord_data_type=kind, abscissa_spacing=spacing)
        return (Path(folder) / "a.uff").read_text()


@pytest.mark.parametrize("kind", [2, 4])
@pytest.mark.parametrize("spacing", [0, 1])
@pytest.mark.parametrize("padding", ["none", "end", "marks", "numbers", "all", "zeros", "crlf"])
def test_padded_universal_files_are_good_files(
    kind: int, spacing: int, padding: str, lab: Path, put: Put
) -> None:
    path = lab / "a.uff"
    lines = functions(kind, spacing).splitlines()
    marks = [index for index, line in enumerate(lines) if line.strip() == "-1"]
    if padding == "end":
        lines[-1] = lines[-1].ljust(80)
    if padding == "marks":
        lines = [line.ljust(80) if index in marks else line for index, line in enumerate(lines)]
    if padding == "numbers":
        lines = [line.ljust(80) if index + 1 in marks[1::2] else line for index, line in enumerate(lines)]
    if padding == "all":
        lines = [line.ljust(80) for line in lines]
    ending = "\r\n" if padding == "crlf" else "\n"
    path.write_bytes((ending.join(lines) + ("\0" * 9 if padding == "zeros" else "")).encode())
    sound(put("uff"), rtol=1e-4 if kind == 2 else 1e-11)


@pytest.mark.parametrize("kind", [2, 4])
@pytest.mark.parametrize("spacing", [0, 1])
@pytest.mark.parametrize(("filling", "code"), [("", 0), (" ", 0), ("0", 0), ("1", 2)])
def test_a_last_line_may_be_filled_with_blanks_or_zeros(
    kind: int, spacing: int, filling: str, code: int, lab: Path, put: Put
) -> None:
    lines = functions(kind, spacing, N - 3).splitlines()
    whole = [f"{float(filling):.5e}" if filling.strip() else ""] * 6
    widths = {(2, 1): [13] * 6, (4, 1): [20] * 4, (2, 0): [13] * 6, (4, 0): [13, 20] * 2}[kind, spacing]
    for last in [at - 1 for at, line in enumerate(lines) if line == "    -1"][1::2]:
        there = len(lines[last].split())
        filled = [word.rjust(width) for word, width in zip(whole, widths, strict=False)]
        lines[last] += "".join(filled[there:]) if filling else ""
    (lab / "a.uff").write_text("\n".join(lines) + "\n")
    found = put("uff")
    if code:
        refused(found, "a.uff: F: found", f"samples, expected {N - 3} as in its header")
    else:
        sound(found, rtol=1e-5 if kind == 2 else 1e-11, samples=N - 3)


@pytest.mark.parametrize("start", [0.0, 12.5])
def test_an_even_function_as_pairs_of_x_and_y(start: float, lab: Path, put: Put) -> None:
    write_functions(lab / "a.uff", abscissa_spacing=0, x=start + clock(), abscissa_min=0.0, abscissa_inc=0.0)
    sound(put("uff"), rtol=1e-11)


def test_a_step_printed_with_six_digits_is_the_rate_of_the_map(
    lab: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write_functions(lab / "a.uff", x=clock(rate_hz=5120))  # in the file 1.95313e-04: 5119.987 Hz
    found = imported(capfd, lab, "uff", CHANNELS, motion_hz=5120)
    assert found.rates == {"force_m": 5120.0, "acceleration_m": 5120.0}
    assert "1 record (1 driven), none held out; next: boltlaw check" in found.out


def test_an_uneven_function_is_refused(lab: Path, put: Put) -> None:
    uneven = clock() + 0.01 * (clock() > 0.05)
    write_functions(lab / "a.uff", abscissa_spacing=0, x=uneven, abscissa_inc=0.0)
    refused(put("uff"), "a.uff: F", "even steps")


@pytest.mark.parametrize("kind", ["Mystery", "Reciprocal", "RTD"])
@pytest.mark.parametrize("known_before", [False, True])
def test_a_scale_of_tdms_that_is_not_applied_is_refused(
    kind: str, known_before: bool, lab: Path, put: Put
) -> None:
    import nptdms

    scales = {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": kind}
    if known_before:
        linear = {
            "Scale_Type": "Linear",
            "Linear_Slope": 2.0,
            "Linear_Y_Intercept": 0.0,
            "Linear_Input_Source": 0xFFFFFFFF,
        }
        scales = {f"NI_Scale[0]_{key}": value for key, value in linear.items()}
        scales |= {"NI_Number_Of_Scales": 2, "NI_Scale[1]_Scale_Type": kind}
    with nptdms.TdmsWriter(str(lab / "a.tdms")) as writer:
        writer.write_segment([
            nptdms.ChannelObject("run", "F", FORCE, {"wf_increment": 1 / HZ, **scales}),
            nptdms.ChannelObject("run", "A", ACCELERATION, {"wf_increment": 1 / HZ}),
        ])  # fmt: skip
    refused(put("tdms"), "a.tdms: F", kind)


def test_a_scale_of_tdms_that_is_applied_is(lab: Path, put: Put) -> None:
    import nptdms

    scale = {
        "Scale_Type": "Linear",
        "Linear_Slope": 0.5,
        "Linear_Y_Intercept": 0.0,
        "Linear_Input_Source": 0xFFFFFFFF,
    }
    scales = {f"NI_Scale[0]_{key}": value for key, value in scale.items()} | {"NI_Number_Of_Scales": 1}
    with nptdms.TdmsWriter(str(lab / "a.tdms")) as writer:
        writer.write_segment([
            nptdms.ChannelObject("run", "F", 2 * FORCE, {"wf_increment": 1 / HZ, **scales}),
            nptdms.ChannelObject("run", "A", ACCELERATION, {"wf_increment": 1 / HZ}),
        ])  # fmt: skip
    sound(put("tdms"))


def test_text_in_tdms_is_named(lab: Path, put: Put) -> None:
    import nptdms

    with nptdms.TdmsWriter(str(lab / "a.tdms")) as writer:
        writer.write_segment([
            nptdms.ChannelObject("run", "F", np.array(["a", "b"])),
            nptdms.ChannelObject("run", "A", ACCELERATION, {"wf_increment": 1 / HZ}),
        ])  # fmt: skip
    refused(put("tdms"), "a.tdms: F", "text")


@pytest.mark.parametrize("how", ["warnings", "log"])
def test_what_a_parser_warns_of_is_told(
    how: str, lab: Path, put: Put, monkeypatch: pytest.MonkeyPatch
) -> None:
    import nptdms

    with nptdms.TdmsWriter(str(lab / "a.tdms")) as writer:
        writer.write_segment([
            nptdms.ChannelObject("run", name, samples, {"wf_increment": 1 / HZ})
            for name, samples in (("F", FORCE), ("A", ACCELERATION))
        ])  # fmt: skip
    read = nptdms.TdmsFile.read

    def warned(path: str) -> Any:
        if how == "log":
            import nptdms.reader

            nptdms.reader.log.warning("segment version mismatch")
        else:
            warnings.warn("segment version mismatch", stacklevel=1)
        return read(path)

    monkeypatch.setattr(nptdms.TdmsFile, "read", warned)
    found = put("tdms")
    sound(found)
    assert "a.tdms (segment version mismatch)" in found.out


def test_a_header_that_apread_guesses_at_is_refused(lab: Path, put: Put) -> None:
    from tests.experiments.source_files import catman_bytes

    raw = catman_bytes({"F": (FORCE, "N", HZ), "A": (ACCELERATION, "m/s2", HZ)})
    spoilt = bytearray(raw)
    spoilt[raw.index(struct.pack("<dd", 45000.0, 1e3 / HZ)) + 140] = 9  # which numbers are in the file
    (lab / "a.bin").write_bytes(bytes(spoilt))
    refused(put("catman"), "a.bin", "apread", "ExportFormat")
