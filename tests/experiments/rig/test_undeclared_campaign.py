"""Campaigns with something undeclared: what the folder shows, what the truth tells, how strong it is."""

import json
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest

from experiments.rig import __main__ as listing
from experiments.rig.campaign import Laboratory
from experiments.rig.excitation import Hit, contact_time
from experiments.rig.plant import Plant
from experiments.rig.schedule import Case
from experiments.rig.sensors import Instruments
from experiments.rig.undeclared import KINDS, Undeclared
from experiments.studies import drawn, rig
from rom.campaign.campaign import read_campaign

ROOT = Path(__file__).parents[3]
SMALL = {"cases": 2, "duration_s": 2.5, "jobs": 1, "seed": 6, "hold_out_every": 0}
HARD = Hit("lo", 1608.7, 0.1, contact_time(1608.7))
EVERYWHERE = [
    (name, place) for name, kind in KINDS.items() for place in kind.allowed if place != "sensor:force_so"
]


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rig.run(tmp_path_factory.mktemp("plain") / "campaign", **SMALL)


def measured(
    *effects: Undeclared, preload: float | None = 60.0, body: str = "lo", noise: float = 1.0
) -> dict[str, np.ndarray]:
    case = Case("", "", Hit(body, HARD.strength, HARD.start, HARD.duration), preload, preload or 0.0)
    laboratory = Laboratory(Plant(effects=effects), Instruments().scaled(noise), 0.5)
    channels, _ = laboratory.measure(case, np.random.SeedSequence(2))
    return {name: channel.samples for name, channel in channels.items()}


@pytest.fixture(scope="module")
def usual() -> dict[str, np.ndarray]:
    return measured(noise=0.0)


def test_no_strength_is_the_same_campaign_to_the_last_bit(plain: Path, tmp_path: Path) -> None:
    none = tuple(Undeclared(name).scaled(0.0) for name in KINDS)
    folder = rig.run(tmp_path / "campaign", **SMALL, undeclared=none)
    assert files(folder) == files(plain)


@pytest.mark.parametrize(("name", "place"), EVERYWHERE)
def test_every_effect_shows_in_its_records_and_none_without_strength(
    name: str, place: str, usual: dict[str, np.ndarray]
) -> None:
    effect = Undeclared(name, place)
    silent, shown = measured(effect.scaled(0.0), noise=0.0), measured(effect, noise=0.0)
    assert all(np.array_equal(silent[channel], usual[channel]) for channel in usual)
    differing = {channel for channel in usual if not np.array_equal(shown[channel], usual[channel])}
    if effect.kind.acts == "reading" or place == "sensor:tension":
        assert differing == {"strain"}
    elif effect.kind.acts == "fault":
        assert differing == {place.removeprefix("sensor:")}
    else:
        assert {"acceleration_lo", "acceleration_so", "strain"} >= differing > set()


def test_with_the_bolt_goes_what_sits_at_it() -> None:
    bare = measured(preload=None, body="so")
    for name in ("jenkins-slip", "tightening", "tension-drift", "calibration-error"):
        assert np.array_equal(
            measured(Undeclared(name), preload=None, body="so")["acceleration_so"], bare["acceleration_so"]
        )
    for effect in (Undeclared("coulomb-friction", "flexure_so"), Undeclared("acceleration-gain")):
        assert not np.array_equal(
            measured(effect, preload=None, body="so")["acceleration_so"], bare["acceleration_so"]
        )


def test_a_fault_is_older_than_the_converter() -> None:
    gain = Undeclared("acceleration-gain", "", {"g": 0.1})
    exact, faulty = (measured(*effects, noise=0.0)["acceleration_so"] for effects in ((), (gain,)))
    assert faulty == pytest.approx(1.1 * exact, rel=1e-12)
    counts = measured(gain)["acceleration_so"] / Instruments().robust.step
    assert counts == pytest.approx(np.round(counts), abs=1e-6)
    noise = measured(gain)["acceleration_so"][:1500] - faulty[:1500]
    assert np.std(noise) < 1.5 * Instruments().robust.noise  # the noise did not pass the gain's chain twice


def test_skew_is_a_delay() -> None:
    late = Undeclared("acceleration-skew", "", {"tau": 10 / 19_200})
    exact, shown = (measured(*effects, noise=0.0)["acceleration_so"] for effects in ((), (late,)))
    assert shown[10:] == pytest.approx(exact[:-10], abs=1e-3 * np.max(np.abs(exact)))


def test_the_folder_does_not_betray_it_and_the_truth_tells_it(
    plain: Path, tmp_path: Path, boltlaw: object
) -> None:
    folder = tmp_path / "campaign"
    ran = boltlaw(  # type: ignore[operator]
        "rig", folder, "--cases", 2, "--duration-s", 2.5, "--jobs", 1, "--seed", 6, "--hold-out-every", 0,
        "--undeclared", "coulomb-friction@flexure_lo:F_c=0.2", "--undeclared", "hum@sensor:tension:A=1,B=0",
        "--quiet",
    )  # fmt: skip
    assert ran.code == 0, ran.err
    here, there = files(folder), files(plain)
    assert list(here) == list(there)
    assert here["campaign.toml"] == there["campaign.toml"]
    assert all(here[name] != there[name] for name in here if "loosening" in name)
    assert not any(
        word in content for content in here.values() for word in (b"coulomb", b"hum", b"undeclared")
    )
    assert len(read_campaign(folder).settings.record) == 6
    truth = json.loads((tmp_path / "campaign.truth.json").read_text())
    friction, hum = truth["undeclared"]
    assert (friction["name"], friction["enters"]) == ("coulomb-friction", "flexure_lo")
    assert friction["parameters"]["F_c"] == {"value": 0.2, "unit": "N"}
    assert friction["parameters"]["v_s"] == {"value": 1e-3, "unit": "m/s"}
    assert 1.0 < friction["influence_percent"]["motion"] <= friction["influence_percent"]["percent"] < 200.0
    assert (hum["name"], hum["enters"], hum["by_record"]) == ("hum", "sensor:tension", "phase")
    phases = [record["undeclared"]["hum@sensor:tension"] for record in truth["records"] if record["preload"]]
    assert len({phase["A"] for phase in phases}) == 4
    assert all(np.hypot(phase["A"], phase["B"]) == pytest.approx(1.0) for phase in phases)
    assert json.loads(plain.with_name("campaign.truth.json").read_text())["undeclared"] == []


@pytest.mark.parametrize("text", ["colomb-friction", "hum@sensor:tention", "coulomb-friction:F_c=-1"])
def test_a_wrong_name_writes_nothing(text: str, tmp_path: Path, boltlaw: object) -> None:
    ran = boltlaw("rig", tmp_path / "new", "--cases", 2, "--undeclared", text)  # type: ignore[operator]
    assert ran.code == 2
    assert ran.err.count("\n") == 1
    assert ran.err.startswith("undeclared")
    assert not list(tmp_path.iterdir())


# --- strength -----------------------------------------------------------------------------------------------


def test_influence_of_a_gain_is_the_gain_and_of_nothing_is_nothing() -> None:
    gain = rig.influence(Undeclared("force-gain", "", {"g": -0.05}))
    assert gain.percent == pytest.approx(5.0, rel=1e-6)
    assert (gain.motion, gain.loss) == (0.0, 0.0)
    assert rig.influence(Undeclared("tightening").scaled(0.0)).percent == 0.0
    offset = rig.influence(Undeclared("calibration-error", "", {"T_0": 0.0, "c_1": 0.1}))
    assert offset.loss == pytest.approx(10.0, rel=1e-6)


def test_influence_on_the_loss_is_the_share_that_is_lost_more() -> None:
    ratchet = Undeclared("loosening-ratchet")
    one, two = (rig.influence(ratchet.scaled(factor)) for factor in (0.01, 0.02))
    assert two.loss == pytest.approx(2.0 * one.loss, rel=0.01)
    assert one.percent == one.loss > one.motion


@pytest.mark.parametrize("name", ["cubic-stiffness", "tension-drift", "acceleration-bias"])
def test_a_drawn_effect_is_felt_as_much_as_was_asked(name: str) -> None:
    one, same, other = (rig.draw(np.random.default_rng(seed), name, percent=(3.0, 8.0)) for seed in (1, 1, 2))
    assert one == same != other
    assert 2.7 < rig.influence(one).percent < 8.9
    for key, number in KINDS[name].numbers_at(one.enters).items():
        assert number.low <= one.parameters[key] <= number.high


@pytest.mark.variant
@pytest.mark.parametrize("name", KINDS)
def test_every_drawn_effect_is_plausible_and_felt(name: str) -> None:
    rng = np.random.default_rng(4)
    for place in KINDS[name].allowed:
        effect = rig.draw(rng, name, place)
        felt = rig.influence(effect).percent
        at_the_end = any(
            abs(effect.parameters[key]) in (abs(number.low), number.high)
            for key, number in effect.kind.numbers_at(place).items()
            if key in effect.kind.strengths
        )
        assert 2.7 < felt < 66.5 or (at_the_end and felt < 2.7)


@pytest.mark.slow
def test_what_can_never_be_felt_that_much_is_drawn_all_the_same() -> None:
    force = rig.draw(np.random.default_rng(3), "constant-force")  # accelerometers do not see one
    assert abs(force.parameters["F_0"]) == 5.0
    assert rig.influence(force).percent < 3.0


def test_a_drawn_campaign_goes_with_seed_and_names_and_its_twin_lacks_the_effects(tmp_path: Path) -> None:
    options = {"cases": 2, "duration_s": 2.5, "jobs": 1, "hold_out_every": 0}
    folder = drawn.run_drawn(
        tmp_path / "one", [Undeclared("hum", "sensor:tension")], (3.0, 60.0), 6, **options
    )
    truth = json.loads(rig.truth_path(folder).read_text())
    rng = np.random.default_rng([6, crc32(b"hum@sensor:tension")])
    assert (
        truth["undeclared"][0]["parameters"] == rig.draw(rng, "hum", "sensor:tension").truth()["parameters"]
    )
    assert truth["seed"] == rng.integers(2**31)
    twin = drawn.twin(folder, tmp_path / "twin")
    one, other = (
        read_campaign(place).load(read_campaign(place).select("loosening")[0]) for place in (folder, twin)
    )
    changed = {
        name
        for name, c in one.channels.items()
        if not np.array_equal(c.samples, other.channels[name].samples)
    }
    assert changed == {"strain"}


def test_what_diverges_is_drawn_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds = []

    def run(_: Path, *, seed: int, **__: object) -> Path:
        seeds.append(seed)
        raise ValueError("the motion diverges")

    monkeypatch.setattr(rig, "run", run)
    with pytest.raises(ValueError, match="diverges"):
        drawn.run_drawn(tmp_path / "one", [], (3.0, 60.0))
    assert len(set(seeds)) == drawn.ATTEMPTS


def test_the_page_lists_what_there_is() -> None:
    page = listing.page()
    assert (ROOT / "docs" / "rig.md").read_text(encoding="utf-8") == page
    assert all(f"| `{name}` |" in page for name in KINDS)
