"""The catalogue: what it holds, where its members can enter, and how one is added."""

import importlib.util
import pickle
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rom
from rom.effects import (
    CATALOGUE,
    Effect,
    LawChange,
    Member,
    Reading,
    SensorFault,
    candidates,
    free_form,
    look_alikes,
    make,
    places,
    register,
)
from rom.model.description import LinkLaws
from rom.model.laws import Parameter, constant_damping, constant_stiffness, logistic_stiffness
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure
from rom.parameters.he_2025 import nominal_impact, paper_model

CHANNELS = ("force_lo", "acceleration_lo", "acceleration_so", "strain")
DOCS = Path(__file__).parents[3] / "docs"


@pytest.mark.parametrize("member", CATALOGUE.values(), ids=lambda member: member.name)
def test_a_member_is_complete(member):
    assert set(member.strengths) <= set(member.parameters)
    assert set(member.inner) <= set(member.parameters) - set(member.strengths)
    assert set(member.ground) <= set(member.parameters)
    assert set(member.by_record) <= set(member.parameters)
    assert member.classes
    assert member.source
    effect = member.at("tension")
    assert all(p.source and p.unit for p in effect.parameters.values())
    for name, least in member.strengths.items():
        low, high = member.parameters[name].bounds
        assert low <= 0.0 < least <= high
        assert abs(member.parameters[name].value) >= least or member.parameters[name].value == 0.0
    for name, grid in member.inner.items():
        low, high = member.ends.get(name, member.parameters[name].bounds)
        assert all(low <= value <= high for value in grid)


def test_a_member_at_a_place_is_of_its_kind():
    kinds = {name: type(member.at("tension")) for name, member in CATALOGUE.items()}
    assert kinds["jenkins-slip"] is Effect
    assert kinds["tightening"] is LawChange
    assert kinds["tension-drift"] is Reading
    assert kinds["hum"] is SensorFault
    assert {CATALOGUE[name].kind for name in kinds} == {"force", "tension rate", "measured tension", "sensor"}


def test_candidates_are_effects_times_places():
    found = {(member.name, effect.enters) for member, effect in candidates(paper_model(), CHANNELS)}
    assert {("cubic-stiffness", "flexure_so"), ("cubic-stiffness", "joint")} <= found
    assert {("extra-mode", "body:so"), ("tightening", "tension"), ("tension-skew", "sensor:tension")} <= found
    assert {("hum", "sensor:acceleration_lo"), ("force-gain", "sensor:force_lo")} <= found
    assert not {("tension-dependent-stiffness", "joint"), ("contact-stiffness", "flexure_lo")} & found
    assert not any(name in ("lugre", "iwan-slip") for name, _ in found)
    assert len(candidates(paper_model(), core=False)) > len(candidates(paper_model()))
    assert "tension" not in places(paper_model().without_bolt())


def test_a_link_to_ground_has_ranges_of_its_own():
    by_place = {e.enters: e for m, e in candidates(paper_model()) if m.name == "cubic-stiffness"}
    assert by_place["flexure_lo"].parameters["k3"].value == 1e9
    assert by_place["joint"].parameters["k3"].value == 4.5e12


def test_a_bolted_link_is_a_joint_even_if_it_ends_at_the_ground():
    paper = paper_model()
    block = Model(
        Structure(
            (Body("block", 2.2),),
            (Link("flexure", "block", "ground"), Link("joint", "block", "ground", "bolted")),
        ),
        {"flexure": paper.link_laws["flexure_lo"], "joint": paper.link_laws["joint"]},
    )
    by_place = {e.enters: e for m, e in candidates(block) if m.name == "cubic-stiffness"}
    assert by_place["flexure"].parameters["k3"].value == 1e9
    assert by_place["joint"].parameters["k3"].value == 4.5e12
    found = {(member.name, effect.enters) for member, effect in candidates(block)}
    assert ("contact-stiffness", "joint") in found
    assert ("tension-dependent-stiffness", "joint") not in found


@pytest.mark.parametrize("stiffness", [9e3, 9e4])
def test_sliders_in_a_flexure_are_tried_near_any_slip_displacement(stiffness):
    member = CATALOGUE["jenkins-slip"]
    probes = [one.values for one in member.probes(member.at("flexure_lo", ground=True))]
    assert len(member.probes(member.at("joint"))) == 3  # at limits that go with the tension
    slips = np.array([limit / (kappa * stiffness) for kappa, limit, _ in probes])
    motions = np.geomspace(5e-5, 5e-4, 20)
    assert np.abs(np.log(slips[:, None] / motions)).min(axis=0).max() < np.log(2.1)


def test_probes_are_weak_one_strength_at_a_time_over_the_grid():
    for member, effect in candidates(paper_model(), CHANNELS, core=False):
        probes = member.probes(effect)
        assert probes
        for probe in probes:
            strengths = {name: probe.parameters[name].value for name in member.strengths}
            (acting,) = [name for name, value in strengths.items() if value]
            default = abs(effect.parameters[acting].value)
            assert strengths[acting] <= default or default == 0.0
    member, effect = next(p for p in candidates(paper_model()) if p[0].name == "two-sided-gap")
    deltas = [probe.parameters["delta"].value for probe in member.probes(effect)]
    assert deltas == pytest.approx([1e-4, 3e-4, 6e-4, 1e-3])  # a flexure moves ten times as far as the joint


def test_the_oscillating_stiffness_goes_along_the_law_of_its_joint():
    law = logistic_stiffness(8e5, -0.03, 15.0)
    joint = replace(paper_model().link_laws["joint"], stiffness=law)
    model = replace(paper_model(), link_laws={**paper_model().link_laws, "joint": joint})
    effect = next(e for m, e in candidates(model) if m.name == "oscillating-tension-stiffness")
    assert effect.parameters["alpha"].value == -0.03
    assert effect.parameters["beta"].value == 15.0
    astray = replace(joint, stiffness=logistic_stiffness(8e5, -0.03, -5e7))
    far = replace(model, link_laws={**model.link_laws, "joint": astray})
    effect = next(e for m, e in candidates(far) if m.name == "oscillating-tension-stiffness")
    assert effect.parameters["beta"].value == effect.parameters["beta"].bounds[0]


def test_an_effects_parameters_vary_in_the_fast_path():
    model = CATALOGUE["coulomb-friction"].at("joint").added_to(paper_model())
    forces = np.tile(nominal_impact(1600.0, 19200, 1.0), (2, 1))
    both = model.final_tension(forces, 19200, [60.0, 60.0], {"joint.coulomb-friction.F_c": [0.0, 5.0]})
    one = model.with_values({"joint.coulomb-friction.F_c": 5.0}).final_tension(forces[:1], 19200, [60.0])
    assert both[1] == pytest.approx(one[0], rel=1e-9)
    assert both[1] - both[0] > 0.1


def test_look_alikes_share_a_class():
    assert "relaxation-log" in look_alikes("tension-drift")
    assert "lugre" in look_alikes("jenkins-slip")
    assert {"quintic-stiffness", "two-sided-gap"} <= set(look_alikes("cubic-stiffness"))
    assert "one-sided-gap" in look_alikes("two-sided-gap")
    assert "loosening-threshold" in look_alikes("loosening-power")
    assert look_alikes("extra-mode") == ()


def test_what_is_no_effect_of_a_model_is_refused():
    with pytest.raises(ValueError, match=r"must be one of .*coulomb-friction.*, got 'friction'"):
        make("friction", "joint", {})
    with pytest.raises(ValueError, match="must have the parameters F_c, mu, v_s, got mu"):
        make("coulomb-friction", "joint", {"mu": Parameter(0.1, "1")})
    effect = CATALOGUE["cubic-stiffness"].at("joint")
    with pytest.raises(ValueError, match="has the parameters k3, got k_3"):
        effect.with_values(k_3=1.0)
    with pytest.raises(ValueError, match="must lie within"):
        effect.with_values(k3=-1e15)
    with pytest.raises(ValueError, match="must be new to the catalogue, got 'hum'"):
        register(Member("hum", ("joint",), "", {}, {}, ("hum",), ""))


def test_places_are_told_by_kind():
    model = paper_model()
    assert [
        CATALOGUE["extra-mode"].at(e).place for e in ("body:so", "joint", "tension", "sensor:tension")
    ] == [
        "body",
        "link",
        "tension",
        "sensor",
    ]
    effect = CATALOGUE["coulomb-friction"].at("joint")
    assert effect.added_to(model).parameter(f"{effect.path}.mu").value == 1.2e-3
    change = CATALOGUE["tightening"].at("tension")
    assert change.added_to(model).parameter(f"{change.path}.g_t").unit == "1/s"


@pytest.mark.parametrize(
    ("name", "enters", "match"),
    [
        ("hum", "sensor:acceleration_x", r"must enter at sensor:force_lo, .*, got 'sensor:acceleration_x'"),
        ("hum", "joint", "must enter at sensor:force_lo"),
        ("hum", "sensor:strain", "sensor:tension, got 'sensor:strain'"),
        ("coulomb-friction", "sensor:force_lo", "must enter at flexure_lo, flexure_so, joint, body:lo"),
        ("tightening", "joint", "must enter at tension, got 'joint'"),
        ("tension-drift", "body:lo", "must enter at tension, got 'body:lo'"),
    ],
)
def test_an_effect_enters_where_its_kind_can(name, enters, match):
    with pytest.raises(ValueError, match=match):
        CATALOGUE[name].at(enters).added_to(paper_model())


def test_what_needs_a_bolt_goes_with_it():
    model = paper_model()
    for name, enters in (("tightening", "tension"), ("hum", "sensor:tension"), ("lugre", "joint")):
        model = CATALOGUE[name].at(enters).added_to(model)
    kept = CATALOGUE["hum"].at("sensor:force_lo").added_to(model)
    assert [effect.enters for effect in kept.without_bolt().effects] == ["sensor:force_lo"]
    for name, enters in (("tightening", "tension"), ("hum", "sensor:tension")):
        with pytest.raises(ValueError, match="must enter at"):
            CATALOGUE[name].at(enters).added_to(model.without_bolt())


def test_an_effect_is_held_once_at_a_place():
    two = free_form("a * x", "flexure_lo", {"a": Parameter(1.0, "N/m")})
    model = two.added_to(free_form("b * v", "joint", {"b": Parameter(1.0, "N s/m")}).added_to(paper_model()))
    assert {"joint.free-form.b", "flexure_lo.free-form.a"} <= set(model.parameters)
    with pytest.raises(ValueError, match="one effect of a name at a place, got two 'free-form' at 'joint'"):
        model.with_effect(free_form("a * x", "joint", {"a": Parameter(1.0, "N/m")}))


def test_a_free_form_force_is_its_equation():
    p = {"a": Parameter(2e6, "N s/m2"), "b": Parameter(1e12, "N/m3")}
    effect = free_form("a * abs(x) * v + b * x ** 3", "joint", p)
    model = paper_model()
    damping = CATALOGUE["displacement-damping"].at("joint").with_values(c_x=2e6)
    cubic = CATALOGUE["cubic-stiffness"].at("joint").with_values(k3=1e12)
    force = {"lo": nominal_impact(1600.0, 19200, 0.7)}
    one = model.with_effect(effect).simulate(force, 19200, 100.0)
    two = model.with_effect(damping).with_effect(cubic).simulate(force, 19200, 100.0)
    x = two.displacement["so"]
    assert one.displacement["so"] == pytest.approx(x, abs=1e-5 * abs(x).max())
    assert make("free-form", "joint", p, effect.equation) == effect
    weaker = effect.with_values(a=1e6)
    assert pickle.loads(pickle.dumps(weaker)) == weaker != effect
    with pytest.raises(ValueError, match="may use t, x, v, T, k, c, a, b, got 'z'"):
        free_form("a * z", "joint", p)


def test_an_effect_of_ones_own_is_added_by_one_file(tmp_path, monkeypatch):
    source, use = re.findall(
        r"```python\n(.*?)```", (DOCS / "own-effect.md").read_text(encoding="utf-8"), re.DOTALL
    )
    path = tmp_path / "clamp_rocking.py"
    path.write_text(source, encoding="utf-8")
    spec = importlib.util.spec_from_file_location("clamp_rocking", path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "clamp_rocking", module)
    spec.loader.exec_module(module)
    monkeypatch.chdir(tmp_path)
    try:
        names = {}
        exec(use, names)  # the guide's own second block
        assert rom.load_model(tmp_path / "model.json").effects == names["model"].effects
        assert np.isfinite(names["response"].displacement["lo"]).all()
    finally:
        rom.effects._members.pop("clamp-rocking", None)


def test_the_printed_catalogue_is_current(capsys):
    from rom.effects.__main__ import main

    main()
    assert capsys.readouterr().out == (DOCS / "effects.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_printed_catalogue_tells_every_parameter_with_its_range(name):
    (row,) = [
        line
        for line in (DOCS / "effects.md").read_text(encoding="utf-8").splitlines()
        if line.startswith(f"| `{name}`")
    ]
    for parameter, number in CATALOGUE[name].parameters.items():
        low, high = number.bounds
        reach = re.escape(f"({low:g} to {high:g})")
        assert re.search(rf"\b{parameter}(\*\*)? \S+ {reach}", row), row


def test_a_change_of_the_law_adds_a_rate_or_is_a_factor_on_it():
    adds = {name for name, member in CATALOGUE.items() if getattr(member.at("tension"), "adds", False)}
    assert adds == {"loosening-displacement", "loosening-dissipation", "loosening-ratchet", "tightening"}


def test_what_needs_a_tension_is_no_candidate_without_a_bolt():
    names = {"oscillating-tension-stiffness", "contact-stiffness", "tension-dependent-stiffness"}
    bolted = paper_model()
    loose = Structure(
        bolted.structure.bodies, tuple(replace(x, law="linear") for x in bolted.structure.links)
    )
    laws = {link.name: LinkLaws(constant_stiffness(1e5), constant_damping(1.0)) for link in loose.links}
    found = {
        m.name: {e.enters for other, e in candidates(bolted) if other is m} for m, _ in candidates(bolted)
    }
    assert {name: found[name] for name in names} == {
        "oscillating-tension-stiffness": {"joint"},
        "contact-stiffness": {"joint"},
        "tension-dependent-stiffness": {"flexure_lo", "flexure_so"},
    }
    without = {m.name for m, _ in candidates(Model(loose, laws))}
    assert not names & without
    assert {"cubic-stiffness", "jenkins-slip"} <= without
