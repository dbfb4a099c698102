"""The example of a plug-in, installed as a user would; plug-ins that are broken or clash."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from numba import cfunc

import discovery
import rom
import rom.effects
from discovery.laws.plug_in_laws import plug_in_laws, usable
from experiments.results import write_result
from rom.identification.identify import Identification
from rom.kernels.function_addresses import SIGNATURES, address_of
from rom.plug_ins import PlugInWarning, packages
from tests.documents.blocks import REPOSITORY
from tests.shared import Shared

EXAMPLE = REPOSITORY / "docs" / "plug-in"
LAW = "slip work, example"


@pytest.fixture(scope="session")
def installed(shared: Shared) -> Path:
    """A folder with the example package, built and installed without network."""
    if int(version("setuptools").partition(".")[0]) < 77:
        pytest.skip("setuptools is older than the example asks for: pip install '.[test]'")

    def work() -> Path:
        target = shared.new_folder()
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]
        source = target / "source"  # a build leaves files beside what it builds
        source.mkdir()
        for file in EXAMPLE.iterdir():
            if file.is_file():
                (source / file.name).write_bytes(file.read_bytes())
        subprocess.run(
            [*pip, "--no-build-isolation", "--target", str(target / "site"), str(source)], check=True
        )
        return target / "site"

    return shared.once("plug-in example", work)


@pytest.fixture
def own_catalogue() -> Iterator[None]:
    """What a test registers goes with it."""
    members = dict(rom.effects._members)
    yield
    rom.effects._members.clear()
    rom.effects._members.update(members)


def program(site: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python where the packages of a folder are installed."""
    path = os.pathsep.join([str(site), str(REPOSITORY)])
    return subprocess.run(
        [sys.executable, *arguments], env={**os.environ, "PYTHONPATH": path},
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def package(site: Path, name: str, code: str, *entries: str) -> None:
    """Write an installed package of one module whose entry points are given as lines."""
    site.mkdir(exist_ok=True)
    (site / f"{name}.py").write_text(code)
    info = site / f"{name}-2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 2.0\n")
    (info / "entry_points.txt").write_text("\n".join(entries) + "\n")


def test_the_example_is_in_catalogue_table_and_simulation(installed: Path, tmp_path: Path) -> None:
    table = program(installed, "-m", "rom.effects")
    assert table.returncode == 0, table.stderr
    assert "| `seal-drag`* | ground |" in table.stdout
    code = f"""
import numpy as np, rom
from rom.effects import CATALOGUE, candidates
effect = CATALOGUE["seal-drag"].at("flexure_lo")
model = rom.paper_model()
force = np.zeros(4000); force[:13] = 1600.0
plain, damped = (m.simulate({{"lo": force}}, rate_hz=19200, initial_tension=300.0)
                 for m in (model, model.with_effect(effect.with_values(c_s=200.0))))
assert damped.status == "ok"
assert np.abs(damped.displacement["lo"]).max() < 0.99 * np.abs(plain.displacement["lo"]).max()
model.with_effect(effect).save(r"{tmp_path / "model.json"}")
assert [e.name for e in rom.load_model(r"{tmp_path / "model.json"}").effects] == ["seal-drag"]
assert "seal-drag" in [member.name for member, _ in candidates(model)]
"""
    ran = program(installed, "-c", code)
    assert ran.returncode == 0, ran.stderr
    assert ran.stderr == ""
    saved = json.loads((tmp_path / "model.json").read_text())
    assert "seal-drag" in json.dumps(saved)


def test_the_example_law_is_one_that_every_race_judges(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(installed))
    (law,) = plug_in_laws()
    assert (law.name, law.source) == (LAW, "given")
    assert packages() == {"boltlaw-example": "1.0"}
    path = write_result(tmp_path / "x.json", "x", {}, campaign=None, seed=None, elapsed_s=0.0)
    assert json.loads(path.read_text())["versions"]["boltlaw-example"] == "1.0"
    with pytest.raises(
        ValueError, match=f"'boltlaw-example': found a law '{LAW}', which 'laws.toml' has too"
    ):
        plug_in_laws([law])


@pytest.mark.slow
def test_compare_judges_the_example_law(
    installed: Path, rig_campaign: Path, rig_identified: Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(installed))
    monkeypatch.setattr("discovery.ranking.specimens.identify_campaign", lambda *_: rig_identified)
    monkeypatch.setattr("discovery.ranking.discover._with_what_is_open", lambda ranking, *_: ranking)
    ranking = discovery.compare(rom.read_campaign(rig_campaign), ["-b * v**2 * max(T, 0)"])
    assert {LAW, "-b * v**2 * max(T, 0)"} <= {law.name for law in ranking.laws}
    assert ranking[LAW].source == "given"
    assert ranking[LAW].parameters["a"].value > 0


BROKEN = {
    "raises": ("raise RuntimeError('no licence')", "RuntimeError: no licence"),
    "empty": ("", "AttributeError: module 'odd' has no attribute 'THINGS'"),
    "wrong": ("THINGS = ['-a * T', 7]", "TypeError: found "),
}


@pytest.mark.parametrize(("code", "told"), BROKEN.values(), ids=BROKEN)
@pytest.mark.usefixtures("own_catalogue")
def test_a_broken_plug_in_is_left_out_with_one_warning(
    code: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = [line for group in ("effects", "laws") for line in (f"[boltlaw.{group}]", "mine = odd:THINGS")]
    package(tmp_path / "site", "odd", code, *lines)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    monkeypatch.delitem(sys.modules, "odd", raising=False)
    known = dict(rom.effects.CATALOGUE)
    for load, group in ((rom.effects._register_plug_ins, "effects"), (plug_in_laws, "laws")):
        with pytest.warns(PlugInWarning) as warned:
            load()
        (one,) = warned
        head = f"plug-in 'odd' is left out: boltlaw.{group}, mine = odd:THINGS: {told}"
        assert str(one.message).startswith(head)
    assert dict(rom.effects.CATALOGUE) == known


def test_a_law_at_rest_or_of_another_unit_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = """
from rom.model.laws import Parameter, free_form_law
REST = "-a * T"
UNIT = free_form_law("u", "-a * abs(v) * T", "tension rate", {"a": Parameter(1.0, "1/s")})
GOOD = "-a * v**2 * T"
"""
    package(
        tmp_path / "site", "rest", code, "[boltlaw.laws]", "r = rest:REST", "s = rest:UNIT", "t = rest:GOOD"
    )
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    with pytest.warns(PlugInWarning) as warned:
        (law,) = plug_in_laws()
    assert law.name == "-a * v**2 * T"
    assert [
        word in str(one.message) for one, word in zip(warned, ("while nothing", "expected N/s"), strict=True)
    ]


def test_a_law_that_is_no_number_along_the_motion_is_left_out() -> None:
    import numpy as np

    from discovery.laws.given import given_law

    laws = [given_law(text) for text in ("-a * abs(v) * T", "-a * abs(v) * log(T / b)")]
    nodes = np.array([[0.0, 1.0], [0.0, 1e-5], [0.0, 0.1], [0.0, 1.0], [0.0, 1.0], [10.0, -1.0]])
    kept, lines = usable(laws, nodes)
    assert [law.name for law in kept] == ["-a * abs(v) * T"]
    (line,) = lines
    assert "not a number" in line


def test_a_function_whose_code_cannot_be_kept_is_compiled_in_memory(tmp_path: Path) -> None:
    names: dict[str, Any] = {}
    code = "def doubled(T, p):\n    return p[0] * T\n"
    exec(compile(code, str(tmp_path / "in_an_archive.py"), "exec"), names)
    with pytest.raises(RuntimeError, match="cannot cache"):
        cfunc(SIGNATURES["stiffness"], cache=True)(names["doubled"])
    assert address_of(names["doubled"], "stiffness") > 0


def test_a_name_that_is_taken_is_one_error_that_names_both(tmp_path: Path) -> None:
    code = "from rom.effects import CATALOGUE\nfrom dataclasses import replace\n"
    code += "MINE = replace(CATALOGUE['coulomb-friction'], source='mine')\n"
    package(tmp_path / "site", "clash", code, "[boltlaw.effects]", "mine = clash:MINE")
    main = "from experiments.cli import main; main()"
    (tmp_path / "campaign.toml").write_text("")  # or else a campaign of another test beside it is the nearest
    ran = program(tmp_path / "site", "-c", main, "close", str(tmp_path))
    (line,) = ran.stderr.splitlines()
    assert ran.returncode == 2
    assert "plug-in 'clash': found an effect 'coulomb-friction', which 'boltlaw' has too" in line


def test_the_commands_warn_in_one_line(tmp_path: Path) -> None:
    package(tmp_path / "site", "odd", "1 / 0", "[boltlaw.effects]", "mine = odd:MINE")
    main = "import experiments.cli as c, sys; c.run = lambda _: __import__('rom.effects') and 0; c.main()"
    ran = program(tmp_path / "site", "-c", main)
    assert ran.returncode == 0
    (line,) = ran.stderr.splitlines()
    assert line.startswith(
        "warning: plug-in 'odd' is left out: boltlaw.effects, mine = odd:MINE: ZeroDivision"
    )
