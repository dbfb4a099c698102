from dataclasses import replace

import numpy as np
import pytest

from benchmarks.sensitivity import final_tension_sensitivity, mean_tensions_sensitivity, motion_sensitivity
from rom.model.laws import constant_damping, constant_stiffness, power_loosening
from rom.model.model import LinkLaws
from rom.parameters.he_2025 import paper_model

RATE = 19200.0


def hit():
    time = np.arange(4000) / RATE
    return 1608.7 * np.sin(np.pi * time / 0.65e-3) * (time < 0.65e-3)


def test_sensitivity_to_gamma_has_its_closed_form():
    """With a linear joint T = T0 exp(-gamma I), so that gamma dT/dgamma = T ln(T / T0)."""
    joint = LinkLaws(constant_stiffness(5e5), constant_damping(200.0), power_loosening(3e5))
    model = replace(paper_model(), link_laws={**paper_model().link_laws, "joint": joint})
    final = model.final_tension(hit()[None], RATE, [150.0], tolerance=1e-9)[0]
    found = final_tension_sensitivity(model, [hit()], RATE, [150.0], ["joint.tension_rate.gamma"])
    assert found[0, 0] == pytest.approx(final * np.log(final / 150.0), rel=1e-5)


def test_sensitivity_is_the_slope_between_wider_steps():
    model, paths = paper_model(), ["joint.damping.c_d", "joint.stiffness.k_i", "body.lo.mass"]
    found = final_tension_sensitivity(model, [hit()], RATE, [60.0], paths)
    for column, path in enumerate(paths):
        value = model.parameter(path).value
        wide = [
            model.final_tension([hit()], RATE, [60.0], {path: value * factor}, tolerance=1e-9)[0]
            for factor in (0.98, 0.99, 1.01, 1.02)
        ]
        slope = (wide[0] - 8 * wide[1] + 8 * wide[2] - wide[3]) / 0.12
        assert found[0, column] == pytest.approx(slope, rel=1e-3)


def test_a_parameter_of_zero_has_no_relative_change():
    with pytest.raises(ValueError, match="parameter must be one of"):
        final_tension_sensitivity(paper_model(), [hit()], RATE, [60.0], ["joint.none"])


def test_sensitivity_of_the_last_bin_is_that_of_the_final_tension():
    model, paths = paper_model(), ["joint.damping.c_d", "joint.tension_rate.gamma_d"]
    edges = np.array([0.0, 1.0, 2000.0, 3999.0, 4000.0]) / RATE
    found = mean_tensions_sensitivity(model, [hit()], RATE, [60.0], edges, paths)
    assert found.shape == (1, 4, 2)
    assert found[0, 0] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert found[:, -1] == pytest.approx(
        final_tension_sensitivity(model, [hit()], RATE, [60.0], paths), rel=1e-6
    )


def test_displacement_answers_to_all_masses_and_forces_alike():
    """Scaled masses, stiffnesses and dampings leave a motion that goes with one over the scale."""
    laws = dict(paper_model().link_laws)
    laws["joint"] = LinkLaws(constant_stiffness(5e5), constant_damping(200.0), power_loosening(3e5))
    model = replace(paper_model(), link_laws=laws)
    paths = [path for path in model.parameters if "tension_rate" not in path]
    found = motion_sensitivity(model, {"lo": hit()}, RATE, 150.0, paths)
    motion = model.simulate({"lo": hit()}, RATE, 150.0).displacement
    for body, slopes in found.items():
        assert slopes.sum(axis=1) == pytest.approx(-motion[body], abs=1e-5 * abs(motion[body]).max())
