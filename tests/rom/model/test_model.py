import itertools
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from rom.effects import CATALOGUE
from rom.model.laws import Parameter, constant_damping, constant_stiffness, free_form_law, power_loosening
from rom.model.model import LinkLaws, Model
from rom.model.structure import Body, Link, Structure
from rom.model_file import ModelFileError, load_model
from rom.parameters.he_2025 import paper_model

RATE = 19200.0


def hit(peak=1608.7, seconds=0.3, tau=0.65e-3):
    time = np.arange(int(seconds * RATE)) / RATE - 0.05
    return peak * np.sin(np.pi * time / tau) * ((time > 0) & (time < tau))


def single(mass=2.0, k=800.0, c=1.6) -> Model:
    structure = Structure((Body("a", mass),), (Link("spring", "a", "ground"),))
    return Model(structure, {"spring": LinkLaws(constant_stiffness(k), constant_damping(c))})


def chain(links=3) -> Model:
    """Bodies in a row, the first one held by a spring, the others each bolted to the one before."""
    bodies = tuple(Body(f"b{i}", 1.0 + 0.1 * i) for i in range(links + 1))
    bolts = tuple(Link(f"j{i}", f"b{i}", f"b{i + 1}", "bolted") for i in range(links))
    paper = paper_model().link_laws
    laws = {"flexure": paper["flexure_lo"]} | {bolt.name: paper["joint"] for bolt in bolts}
    return Model(Structure(bodies, (Link("flexure", "b0", "ground"), *bolts)), laws)


def test_a_free_oscillator_follows_the_closed_form():
    response = single().simulate({"a": np.zeros(4000)}, 1000.0, None, {"a": 0.01}, {"a": -0.1})
    decay, omega = 0.4, np.sqrt(400.0 - 0.16)
    t = np.arange(4000) / 1000.0
    expected = np.exp(-decay * t) * (
        0.01 * np.cos(omega * t) + (-0.1 + decay * 0.01) / omega * np.sin(omega * t)
    )
    assert response.status == "ok"
    assert abs(response.displacement["a"] - expected).max() < 1e-12
    assert response.tension == {}
    assert np.array_equal(response.time, t)


def test_paper_s_losses_have_the_size_that_the_paper_prints():
    losses = 300.0 - paper_model().final_tension([hit(), 0.02 * hit()], RATE, [300.0, 300.0])
    assert 2.0 < losses[0] < 5.0
    assert 0.0 < losses[1] < 1e-4


def test_fast_path_and_full_response_agree():
    model, forces, tensions = paper_model(), np.stack([hit(), hit(800.0)]), np.array([21.5, 152.7])
    final = model.final_tension(forces, RATE, tensions)
    window = model.final_tension(forces, RATE, tensions, window_s=(0.1, 0.2))
    for case in range(2):
        response = model.simulate({"lo": forces[case]}, RATE, tensions[case])
        loss = tensions[case] - response.tension[-1]
        assert final[case] == pytest.approx(response.tension[-1], abs=1e-5 * loss)
        assert window[case] == pytest.approx(response.tension[1920:3841].mean(), abs=1e-5 * loss)
        assert 0 < response.estimated_error < 1e-4
        assert response.steps > 10


def test_cases_may_differ_in_parameters():
    model = paper_model()
    path = "joint.tension_rate.gamma_d"
    forces, tensions = np.stack([hit()] * 3), np.full(3, 150.0)
    together = model.final_tension(
        forces, RATE, tensions, vary={path: [11.0, 11.79, 12.0], "body.so.mass": 1.0}
    )
    for case, value in enumerate((11.0, 11.79, 12.0)):
        alone = model.with_values({path: value, "body.so.mass": 1.0})
        assert alone.final_tension(forces[:1], RATE, [150.0])[0] == together[case]
    assert (np.diff(together) < 0).all()


def test_mapped_records_are_used_as_they_are(tmp_path):
    np.save(tmp_path / "forces.npy", hit()[None])
    mapped = np.load(tmp_path / "forces.npy", mmap_mode="r")
    model = paper_model()
    assert model.final_tension(mapped, RATE, [60.0]) == model.final_tension(hit()[None], RATE, [60.0])


def test_tightening_without_end_is_a_result_and_not_an_exception():
    laws = dict(paper_model().link_laws)
    runaway = free_form_law("runaway", "g * v * v * T * T", "tension rate", {"g": Parameter(1e9, "s/m2/N")})
    laws["joint"] = LinkLaws(laws["joint"].stiffness, laws["joint"].damping, runaway)
    model = Model(paper_model().structure, laws)
    response = model.simulate({"lo": hit()}, RATE, 300.0)
    assert response.status == "diverged"
    assert response.tension[0] == 300.0
    assert np.isnan(response.tension[-1])
    assert np.isnan(model.final_tension(hit()[None], RATE, [300.0])).all()


def test_an_unstable_structure_diverges_quietly():
    response = single(k=-1e9).simulate({"a": np.ones(20000)}, RATE, None)
    assert response.status == "diverged"


def test_a_motion_without_finite_accelerations_diverges():
    start = {"a": 1e300}, {"a": 0.0}
    response = single(k=1e9).simulate({"a": np.zeros(200)}, RATE, None, *start)
    assert np.isfinite(response.displacement["a"]).all()
    assert response.status == "diverged"


def test_net_tightening_raises_the_tension():
    laws = dict(paper_model().link_laws)
    laws["joint"] = LinkLaws(laws["joint"].stiffness, laws["joint"].damping, power_loosening(-1e6))
    assert Model(paper_model().structure, laws).simulate({"lo": hit()}, RATE, 300.0).tension[-1] > 300.1


def test_a_loose_bolt_stays_loose():
    response = paper_model().simulate({"lo": hit()}, RATE, 0.0)
    assert response.status == "ok"
    assert not response.tension.any()


def test_every_bolt_has_its_own_tension():
    model = chain()
    tensions = {"j0": 100.0, "j1": 50.0, "j2": 300.0}
    force = hit(100.0)
    response = model.simulate({"b0": force}, RATE, tensions)
    final = model.final_tension(force[None], RATE, [list(tensions.values())])
    assert list(response.tension) == ["j0", "j1", "j2"]
    for place, (bolt, start) in enumerate(tensions.items()):
        assert response.tension[bolt][0] == start
        assert 0 < response.tension[bolt][-1] < start
        assert final[0, place] == pytest.approx(response.tension[bolt][-1], abs=1e-8)


def test_a_large_structure_goes_link_by_link_to_the_same_result(monkeypatch):
    model, tensions = chain(), {"j0": 100.0, "j1": 50.0, "j2": 300.0}
    dense = model.simulate({"b0": hit(100.0)}, RATE, tensions)
    many = model.final_tension(hit(100.0)[None], RATE, [list(tensions.values())], window_s=(0.1, 0.2))
    monkeypatch.setattr("rom.model.assembly.DENSE_BODIES", 2)
    links = model.simulate({"b0": hit(100.0)}, RATE, tensions)
    assert np.isnan(links.estimated_error)
    for bolt, start in tensions.items():
        error = abs(links.tension[bolt] - dense.tension[bolt]).max()
        assert error < 1e-4 * (start - dense.tension[bolt][-1])
    for body in ("b0", "b3"):
        for one, other in ((links.velocity, dense.velocity), (links.acceleration, dense.acceleration)):
            assert abs(one[body] - other[body]).max() < 1e-4 * abs(other[body]).max()
    again = model.final_tension(hit(100.0)[None], RATE, [list(tensions.values())], window_s=(0.1, 0.2))
    assert again == pytest.approx(many, rel=1e-6)


def test_a_model_file_gives_the_same_model(tmp_path):
    model = paper_model()
    model.save(tmp_path / "model.json", campaign="rig", seed=7)
    text = (tmp_path / "model.json").read_text()
    data = json.loads(text)
    assert (data["format"], data["campaign"], data["seed"], data["elapsed_s"]) == (
        "boltlaw-model/1",
        "rig",
        7,
        None,
    )
    assert "NaN" not in text
    assert "Infinity" not in text
    assert load_model(tmp_path / "model.json") == model
    assert [path.name for path in tmp_path.iterdir()] == ["model.json"]


def test_a_model_file_keeps_a_free_form_law(tmp_path):
    laws = dict(paper_model().link_laws)
    mine = free_form_law("mine", "-g * abs(v) ** 3 * T", "tension rate", {"g": Parameter(1e6, "s2/m3")})
    laws["joint"] = LinkLaws(laws["joint"].stiffness, laws["joint"].damping, mine)
    model = Model(paper_model().structure, laws)
    model.save(tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert again.final_tension(hit()[None], RATE, [60.0]) == model.final_tension(hit()[None], RATE, [60.0])


@pytest.mark.parametrize(
    "text",
    ["", "[]", "[" * 100_000, '{"format": "boltlaw-model/2"}', '{"format": "boltlaw-model/1"}', "\x00\xff"],
)
def test_what_is_no_model_file_is_refused_by_name(tmp_path, text):
    path = tmp_path / "other.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ModelFileError, match=r"other\.json"):
        load_model(path)


@pytest.mark.parametrize("section", ["bodies", "links", "effects", "filter", "calibration", "windows"])
@pytest.mark.parametrize("change", ["missing", "another kind", "another value"])
def test_a_fault_in_a_model_file_is_said_by_its_section_not_by_python(tmp_path, section, change):
    path = tmp_path / "model.json"
    paper_model().save(path)
    data = json.loads(path.read_text(encoding="utf-8"))
    if change == "missing":
        del data[section]
    else:
        data[section] = 7 if change == "another kind" else [["a", "b"], ["c", "d"]]
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(ModelFileError, match=rf"model\.json: {section}: .*, found ") as caught:
        load_model(path)
    assert not re.search(r"Error|indices|attribute|iterable|subscriptable", str(caught.value))


def test_new_values_leave_the_old_model_alone():
    model = paper_model()
    other = model.with_values({"joint.stiffness.k_i": 1e6, "body.lo.mass": 9.0})
    assert other.parameter("joint.stiffness.k_i").value == 1e6
    assert other.structure.masses[0] == 9.0
    assert model.parameter("joint.stiffness.k_i").value == 9.763e5
    assert other.parameter("joint.stiffness.alpha") == model.parameter("joint.stiffness.alpha")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: m.simulate({}, RATE, 60.0), "one at least"),
        (lambda m: m.simulate(hit(), RATE, 60.0), "must map bodies to arrays"),
        (lambda m: m.simulate({"third": hit()}, RATE, 60.0), "must act on lo, so, got third"),
        (lambda m: m.simulate({"lo": [1.0]}, RATE, 60.0), "at least 2 samples"),
        (lambda m: m.simulate({"lo": hit(), "so": hit()[1:]}, RATE, 60.0), "one length"),
        (lambda m: m.simulate({"lo": [0.0, np.nan]}, RATE, 60.0), "must be finite"),
        (lambda m: m.simulate({"lo": hit()}, 0.0, 60.0), "rate_hz must be a finite number > 0, got 0.0"),
        (
            lambda m: m.simulate({"lo": hit()}, RATE, -1.0),
            "initial_tension of 'joint' must be a finite number >= 0",
        ),
        (lambda m: m.simulate({"lo": hit()}, RATE), "must be given for the bolted links"),
        (lambda m: m.simulate({"lo": hit()}, RATE, {"bolt": 1.0}), "bolted links"),
        (
            lambda m: m.simulate({"lo": hit()}, RATE, 60.0, {"x": 1.0}),
            "initial_displacement must name lo, so",
        ),
        (lambda m: m.final_tension([hit(), hit() * np.nan], RATE, [60.0] * 2), "forces must be finite"),
        (lambda m: m.final_tension(hit(), RATE, [60.0]), r"must have the shape \(cases, samples\)"),
        (
            lambda m: m.final_tension([hit()], RATE, [60.0, 60.0]),
            r"initial_tension must have the shape \(1,\)",
        ),
        (lambda m: m.final_tension([hit()], RATE, [60.0], window_s=(1.0, 2.0)), "window_s must hold samples"),
        (
            lambda m: m.final_tension([hit()], RATE, [60.0], vary={"joint.x": [1.0]}),
            "parameter must be one of",
        ),
        (lambda m: m.final_tension([hit()], RATE, [60.0], body="third"), "must act on lo, so"),
        (
            lambda m: m.mean_tensions([hit()], RATE, [60.0], [0.1]),
            r"edges_s must have the shape \(bins \+ 1,\)",
        ),
        (lambda m: m.mean_tensions([hit()], RATE, [60.0], [[0, 1], [0, 1]]), "edges_s must have the shape"),
        (lambda m: m.mean_tensions([hit()], RATE, [60.0], [0.1, 0.1]), "edges_s must rise and hold a sample"),
        (lambda m: m.mean_tensions([hit()], RATE, [60.0], [0.1, np.nan]), "edges_s must be finite"),
        (lambda m: m.mean_tensions([hit()], RATE, [60.0], [0.3, 0.4]), "within 0 to 0.3 s"),
        (
            lambda m: m.mean_tensions([hit()], RATE, [60.0], [0.0, 0.1], tension_rate_hz=5000.0),
            "must divide the rate of 19200 Hz",
        ),
        (lambda m: m.parameter("joint.k"), "parameter must be one of"),
        (lambda m: m.with_values({"body.lo.mass": -1.0}), "must be a positive number of kg"),
    ],
)
def test_wrong_input_says_what_was_required_and_what_came(call, message):
    with pytest.raises(ValueError, match=message):
        call(paper_model())


def test_laws_must_fit_the_structure():
    paper = paper_model()
    with pytest.raises(ValueError, match="laws must be given for the links"):
        Model(paper.structure, {})
    with pytest.raises(ValueError, match="only bolted links have a tension law"):
        Model(paper.structure, {**paper.link_laws, "joint": paper.link_laws["flexure_lo"]})
    with pytest.raises(ValueError, match="must be a law that enters there"):
        LinkLaws(constant_damping(1.0), constant_damping(1.0))


def binned(tension, edges, every=1):
    """Means of the samples of a response, as a measured tension is binned."""
    return np.array(
        [tension[-(-a // every) * every : b : every].mean() for a, b in itertools.pairwise(edges)]
    )


@pytest.mark.parametrize("seconds", [0.05, 0.3, 1.3])
@pytest.mark.parametrize("every", [1, 4])
def test_mean_tensions_are_the_binned_response(seconds, every):
    rng, model, samples = np.random.default_rng(5), paper_model(), int(seconds * RATE)
    force = np.zeros(samples) + 0.1 * rng.normal(size=samples)
    force[samples // 3 : samples // 3 + 13] += 1500.0
    response = model.simulate({"lo": force}, RATE, 61.3)
    loss = 61.3 - response.tension[-1]
    for edges in (
        [0, samples],
        [0, 4, 8, 300],
        np.arange(samples // 3 - 40, samples // 3 + 200, 8),
        [5, 77, samples],
    ):
        found = model.mean_tensions(
            [force], RATE, [61.3], np.array(edges) / RATE, tension_rate_hz=RATE / every
        )
        assert found.shape == (1, len(edges) - 1)
        assert found[0] == pytest.approx(binned(response.tension, edges, every), abs=2e-6 * loss)


def test_bins_may_differ_between_cases_and_end_before_the_record():
    model, forces, tensions = paper_model(), np.stack([hit(), hit(800.0)]), np.array([21.5, 152.7])
    edges = np.array([[0.0, 0.06, 0.2], [0.01, 0.1, 5.0]])
    found = model.mean_tensions(forces, RATE, tensions, edges, {"joint.tension_rate.gamma_d": [11.7, 11.9]})
    for case, gamma_d in enumerate((11.7, 11.9)):
        other = model.with_values({"joint.tension_rate.gamma_d": gamma_d})
        alone = other.mean_tensions(forces[case : case + 1], RATE, tensions[case : case + 1], edges[case])
        assert found[case] == pytest.approx(alone[0], abs=1e-12)
    last = model.final_tension(forces, RATE, tensions)
    sample = np.array([5759.0, 5760.0]) / RATE
    assert model.mean_tensions(forces, RATE, tensions, sample)[:, 0] == pytest.approx(last, abs=1e-12)


def test_a_diverged_case_has_no_mean_tensions_and_the_others_do():
    laws = dict(paper_model().link_laws)
    runaway = free_form_law("runaway", "g * v * v * T * T", "tension rate", {"g": Parameter(1e9, "s/m2/N")})
    laws["joint"] = LinkLaws(laws["joint"].stiffness, laws["joint"].damping, runaway)
    model = Model(paper_model().structure, laws)
    found = model.mean_tensions([hit(), hit(0.0)], RATE, [300.0, 300.0], [0.0, 0.1, 0.2])
    assert np.isnan(found[0]).all()
    assert found[1] == pytest.approx(300.0)


def test_every_bolt_has_mean_tensions():
    model, start = chain(), [100.0, 50.0, 300.0]
    response = model.simulate({"b0": hit(100.0)}, RATE, dict(zip(("j0", "j1", "j2"), start, strict=True)))
    found = model.mean_tensions(hit(100.0)[None], RATE, [start], [0.0, 0.055, 0.3])
    for place, tension in enumerate(response.tension.values()):
        loss = start[place] - tension[-1]
        assert found[0, :, place] == pytest.approx(binned(tension, [0, 1056, 5760]), abs=1e-5 * loss)


@pytest.mark.parametrize("place", [23000, 23001, 23015, 23511, 24063, 24575, 25599])
def test_a_second_hit_anywhere_in_the_ring_down_is_seen(place, monkeypatch):
    model, force = paper_model(), np.pad(hit(seconds=0.1), (0, 25600 - 1920))
    quiet = model.final_tension(force[None], RATE, [150.0])[0]
    force[place : place + 12] += 300.0
    found = model.final_tension(force[None], RATE, [150.0])[0]
    bins = model.mean_tensions(force[None], RATE, [150.0], [0.0, 1.0, 25600 / RATE])[0]
    monkeypatch.setattr("rom.model.batch.DENSE_BODIES", 0)
    exact = model.final_tension(force[None], RATE, [150.0])[0]
    assert found == pytest.approx(exact, abs=1e-4 * (150.0 - exact))
    assert bins == pytest.approx(
        model.mean_tensions(force[None], RATE, [150.0], [0.0, 1.0, 25600 / RATE])[0],
        abs=1e-4 * (150.0 - exact),
    )
    assert place > 25590 or quiet - found > 1e-3


def test_another_tension_law_enters_the_bolted_link_alone():
    model = paper_model()
    changed = model.with_tension_law(power_loosening(3e6, 3.5))
    assert changed.link_laws["joint"] == replace(
        model.link_laws["joint"], tension_rate=power_loosening(3e6, 3.5)
    )
    assert replace(changed, link_laws=model.link_laws) == model
    with pytest.raises(ValueError, match="link must be one of the bolted links"):
        model.with_tension_law(power_loosening(3e6), "flexure_lo")
    with pytest.raises(ValueError, match="link must be one of the bolted links"):
        model.without_bolt().with_tension_law(power_loosening(3e6))


def test_effects_are_had_by_kind_in_their_order():
    named = (
        ("hum", "sensor:force_lo"), ("cubic-stiffness", "joint"), ("relaxation-log", "tension"),
        ("tightening", "tension"), ("coulomb-friction", "flexure_lo"),
    )  # fmt: skip
    model = paper_model()
    for name, enters in named:
        model = model.with_effect(CATALOGUE[name].at(enters))
    assert [e.name for e in model.effects_of("force")] == ["cubic-stiffness", "coulomb-friction"]
    kinds = [model.effects_of(kind) for kind in ("law change", "reading", "sensor fault")]
    assert [[e.name for e in found] for found in kinds] == [["tightening"], ["relaxation-log"], ["hum"]]
    assert model.without_effects_of("force", "reading").effects == (model.effects[0], model.effects[3])
