"""Errors of a tracked path, its plan, and the error message for a run without one."""

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest

from pincette.control.planning.segments import paths_of
from pincette_study import printed
from pincette_study.closed_loop import Record, StudyError, errors, record, rms, tracking_plan
from tests.support.rigs import demo_rig

COUNT = 400


def a_record() -> Record:
    """Two cycles of 8 µm and 20 mN, each with a different error."""
    swing = np.sin(2.0 * pi * np.arange(COUNT) / (COUNT // 2))
    ripple = np.where(np.arange(COUNT) % 2 == 0, 1.0, -1.0)
    x_r_um, force_r_mN, nothing = 4.0 * swing, 10.0 * swing, np.zeros(COUNT)
    return Record(
        t_s=np.linspace(0.0, 7.98, COUNT),
        x_um=x_r_um + 0.08 * ripple,
        x_r_um=x_r_um,
        true_x_um=x_r_um + 0.04,
        force_mN=force_r_mN - 0.5,
        force_r_mN=force_r_mN,
        true_force_mN=force_r_mN + 0.2 * ripple,
        voltage_V=nothing,
        sliding_um=nothing,
        band_um=nothing,
        perturbation_error_mN=nothing,
        residual_um=nothing,
        stiffness_mN_per_um=2.5,
    )


def test_errors_are_computed_from_the_measured_position_and_the_true_force() -> None:
    found = errors(a_record())
    assert found.position_um == pytest.approx(0.08)
    assert found.position_percent == pytest.approx(1.0)
    assert found.force_mN == pytest.approx(0.2)
    assert found.force_percent == pytest.approx(1.0)
    assert (found.largest_um, found.largest_mN) == pytest.approx((0.08, 0.2))
    assert found.true_position_percent == pytest.approx(0.5)
    assert found.estimated_force_percent == pytest.approx(2.5)


def test_the_largest_error_may_have_either_sign() -> None:
    seen = a_record()
    x_um = seen.x_um.copy()
    x_um[7] -= 3.0
    assert errors(replace(seen, x_um=x_um)).largest_um == pytest.approx(3.08)


def test_the_true_stiffness_is_the_slope_of_the_true_values() -> None:
    seen = a_record()
    pressed = replace(seen, true_force_mN=2.2 * (seen.true_x_um - 1.0))
    assert pressed.true_stiffness == pytest.approx(2.2)


def test_the_rms_value_is_correct() -> None:
    assert rms(np.array([3.0, -4.0])) == pytest.approx(sqrt(12.5))


@pytest.mark.parametrize("stiffness", [None, 2.4])
def test_a_force_path_has_the_peak_to_peak_position_of_the_paper(
    stiffness: float | None,
) -> None:
    rig = demo_rig(time="lockstep")
    plan = tracking_plan(rig, stiffness_mN_per_um=stiffness)
    planned = stiffness or rig.part.stiffness_mN_per_um
    (path,) = [path for segment in plan.program.segments for path in paths_of(segment)]
    ticks = round((path.full_to_s - path.full_from_s) / 0.02)
    forces = [path.at(path.full_from_s + 0.02 * tick) for tick in range(ticks)]
    assert max(forces) - min(forces) == pytest.approx(planned * printed.X_PP_UM)
    # The part stays pressed.
    assert min(forces) == pytest.approx(4.0)
    assert plan.program.contact_stiffness_mN_per_um == planned


def test_a_faster_path_lasts_the_same_number_of_seconds() -> None:
    rig = demo_rig(time="lockstep")
    spans = [
        path.full_to_s - path.full_from_s
        for hz in (0.5, 5.0)
        for segment in tracking_plan(rig, frequency_hz=hz).program.segments
        for path in paths_of(segment)
    ]
    assert spans[0] == pytest.approx(spans[1])


def test_a_run_without_the_phase_is_reported() -> None:
    with pytest.raises(StudyError, match="no track: ended"):
        record([], "track", 0.02)
