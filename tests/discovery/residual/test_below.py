"""A step of a fit is followed to the end only if it leaves less than the model before it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from discovery.explain.motion_fit import _too_slow
from discovery.residual import output_error
from discovery.residual.base import cost
from discovery.residual.output_error import WhitenedResidual
from discovery.residual.trajectory import MeasuredTrajectory
from experiments.studies.rig import Undeclared
from rom.effects import CATALOGUE
from tests.discovery.rig_campaigns import start

CUBIC = Undeclared("cubic-stiffness", "flexure_lo", {"k3": 1e9})


def followed_files(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Files of the records that are followed from now on."""
    files, follow = [], output_error.linearised_parts

    def counted(trace: MeasuredTrajectory, *rest: object) -> object:
        files.append(trace.settings.file)
        return follow(trace, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(output_error, "linearised_parts", counted)
    return files


def test_a_step_that_leaves_less_is_followed_whole_and_one_too_far_is_given_up_after_a_few_records(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    residual = start(CUBIC).residual
    assert isinstance(residual, WhitenedResidual)
    near = residual.baseline
    effect = CATALOGUE["cubic-stiffness"].at("flexure_lo", ground=True)
    right, wrong = (replace(near, model=effect.with_values(k3=k3).added_to(near.model)) for k3 in (1e9, 2e10))
    whole, files = residual.at(right), followed_files(monkeypatch)
    after = residual.below(right, 1.01 * cost(whole))
    assert after is not None
    assert after.names == whole.names
    np.testing.assert_array_equal(after.residual, whole.residual)
    np.testing.assert_array_equal(after.jacobian, whole.jacobian)
    assert sorted(files) == sorted(residual.samples)
    files.clear()
    assert residual.below(wrong, cost(residual)) is None
    assert 0 < len(files) < len(residual.samples) - len(residual.hold_out)
    assert not residual.hold_out & set(files)
    assert residual.below(right, cost(whole)) is None


def test_a_fit_is_given_up_where_ten_times_its_pace_would_not_lead_to_what_is_enough() -> None:
    slow, fast = (list(share ** np.arange(8.0)) for share in (0.99, 0.5))
    assert _too_slow(slow, 5, 0.5)
    assert not _too_slow(slow, 20, 0.5)
    assert not _too_slow(fast, 5, 0.5 * fast[-1] / 2**5)
    assert not _too_slow(slow, 0, 0.99)  # there already
    assert not _too_slow(slow[:5], 5, 0.5)  # too few steps tell a pace
