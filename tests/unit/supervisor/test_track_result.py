"""Figures of a tracked path computed from samples with known figures."""

from math import sqrt

import pytest

from pincette.control.record import replace
from pincette.core.messages import Message
from pincette.records.columns import columns
from pincette_supervisor.kinds.track import TrackResult
from pincette_supervisor.kinds.track.functions import evaluate
from pincette_supervisor.plugin.result import full_amplitude
from tests.support.arms import with_arm

from . import samples
from .samples import PATH, PERIOD_S, Tick, run_of

X_PP_UM = 20.0 / samples.STIFFNESS


def result_of(ticks: list[Tick]) -> TrackResult:
    return result_from([m for tick in ticks for m in tick.messages()])


def result_from(messages: list[Message]) -> TrackResult:
    result = evaluate(run_of("track", columns(messages, PERIOD_S))).result
    assert isinstance(result, TrackResult)
    return result


def test_a_track_states_the_figures_of_its_request() -> None:
    result = result_of(samples.track())
    assert (result.outcome, result.shape) == ("tracked", "sinusoid")
    # Two cycles of 2 s, and not a sample more.
    assert result.tracked_samples == 200
    assert result.force_pp_mN == pytest.approx(20.0)
    assert result.x_pp_um == pytest.approx(X_PP_UM)
    position, force, true_force = result.position_um, result.force_mN, result.true_force_mN
    assert position is not None
    assert force is not None
    assert true_force is not None
    assert position.rmse == pytest.approx(0.03 / sqrt(2.0), rel=0.02)
    assert position.rmse_percent == pytest.approx(100.0 * position.rmse / X_PP_UM)
    assert position.maximum == pytest.approx(0.03, rel=0.01)
    assert force.rmse == pytest.approx(samples.FORCE_ERROR_MN)
    assert force.rmse_percent == pytest.approx(5.0 * samples.FORCE_ERROR_MN)
    assert true_force.rmse == pytest.approx(-samples.TRUE_ERROR_MN)
    assert true_force.maximum == pytest.approx(-samples.TRUE_ERROR_MN)
    assert result.force_uncertainty_mN == samples.UNCERTAINTY_MN


def test_the_evaluated_part_of_a_path_consists_of_whole_cycles_at_full_amplitude() -> None:
    ticks = samples.track()
    table = columns([m for tick in ticks for m in tick.messages()], PERIOD_S)
    full = full_amplitude(run_of("track", table), [PATH])
    forces = [f for f, there in zip(table["force_r_mN"], full, strict=True) if there]
    assert forces[0] == pytest.approx(12.0)
    assert forces[1] > 12.0
    assert forces[-1] < 12.0
    assert sum(forces) / len(forces) == pytest.approx(12.0)


def test_an_error_in_the_transitions_of_a_path_does_not_count() -> None:
    ticks = samples.track()
    far = with_arm(ticks[60].position, x_um=99.0)
    position = result_of([*ticks[:60], replace(ticks[60], position=far), *ticks[61:]]).position_um
    assert position is not None
    assert position.maximum < 0.05


def test_on_a_real_rig_the_true_force_is_unknown() -> None:
    ticks = samples.track()
    messages = [m for tick in ticks for m in tick.messages()[:-1]]
    result = result_from(messages)
    assert result.true_force_mN is None
    assert result.true_perturbation_error_mN is None


def test_a_job_that_never_tracked_has_no_figures_of_the_path() -> None:
    result = result_of(samples.grip()[:200])
    assert result.tracked_samples == 0
    assert (result.position_um, result.force_mN, result.true_force_mN) == (None, None, None)
    assert result.x_pp_um is None
    assert result_of([]).samples == 0


def test_the_contact_line_has_standard_errors() -> None:
    result = result_of(samples.track())
    assert result.contact_stiffness_error_mN_per_um is not None
    assert 0.0 < result.contact_stiffness_error_mN_per_um < 0.1
    assert result.contact_x_error_um is not None
