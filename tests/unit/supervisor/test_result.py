"""Figures of a grip computed from samples with known figures."""

from itertools import pairwise
from math import sqrt

import pytest
from msgspec.structs import fields

from pincette.api.job_kinds import job_kinds
from pincette.config import derived, read_rig
from pincette.control.force.estimation import COVERAGE
from pincette.control.record import replace
from pincette.core.faults import Acted, Cause, Mode, Outcome
from pincette.core.messages import Applied, Estimate, Message
from pincette.records.columns import ARMS, COLUMNS, SECOND_COLUMNS, columns, missed
from pincette_supervisor.kinds.grip import GripResult
from pincette_supervisor.kinds.grip.functions import evaluate
from pincette_supervisor.results.documents import verdict
from tests.support.arms import with_arm
from tests.support.rigs import DEMO

from . import samples
from .samples import PERIOD_S, Tick, run_of


def result_of(ticks: list[Tick]) -> GripResult:
    return result_from([m for tick in ticks for m in tick.messages()])


def result_from(messages: list[Message]) -> GripResult:
    result = evaluate(run_of("grip", columns(messages, PERIOD_S))).result
    assert isinstance(result, GripResult)
    return result


def test_the_force_held_is_a_mean_in_which_noise_is_averaged() -> None:
    rig = read_rig(DEMO)
    reading_mN = rig.sensor.noise_um / rig.model.compliance_um_per_mN
    u_mN = result_of(samples.grip()).force_uncertainty_mN
    assert u_mN is not None
    g = derived.force_observer(rig).noise_gain
    without_mN = sqrt(samples.UNCERTAINTY_MN**2 - (COVERAGE * g * reading_mN) ** 2)
    assert without_mN < u_mN < 0.5 * (without_mN + samples.UNCERTAINTY_MN)


def test_a_grip_states_the_figures_of_its_request() -> None:
    result = result_of(samples.grip())
    assert result.outcome == "gripped"
    assert result.force_held_mN == pytest.approx(20.0 + samples.FORCE_ERROR_MN)
    assert result.force_error_mN == pytest.approx(samples.FORCE_ERROR_MN)
    assert result.rmse_force_mN == pytest.approx(samples.FORCE_ERROR_MN)
    assert result.rmse_position_um == pytest.approx(0.03 / sqrt(2.0), rel=0.02)
    assert result.contact_rmse_force_mN == pytest.approx(samples.FORCE_ERROR_MN / sqrt(2.0))
    assert result.peak_force_mN == pytest.approx(20.0 + samples.FORCE_ERROR_MN)
    assert result.final_force_mN == pytest.approx(0.0)
    assert result.contact_x_um == samples.CONTACT_UM
    assert result.contact_stiffness_mN_per_um == samples.STIFFNESS
    assert result.true_force_held_mN == pytest.approx(20.0)
    # The hold is off the line of the load by the error of its force.
    off = samples.FORCE_ERROR_MN / 20.0 * samples.STIFFNESS
    assert result.contact_stiffness_error_mN_per_um == pytest.approx(off, abs=0.005)
    # Stiffness and place are means over the forces of the load.
    assert result.contact_load is not None
    assert result.contact_load.lowest_mN < 2.0
    assert result.contact_load.highest_mN == pytest.approx(20.0)
    assert result.residual_um is not None
    assert result.residual_um.p99 == pytest.approx(0.05)
    assert (result.missed_ticks, result.unanswered_ticks) == (0, 0)


@pytest.mark.parametrize(
    ("change", "mismatch"), [(None, False), (0.003, False), (0.03, True), (-0.03, True)]
)
def test_a_result_states_that_the_stroke_has_changed(
    change: float | None, *, mismatch: bool
) -> None:
    messages = [
        with_arm(message, stroke_change=change, stroke_limit=None if change is None else 0.004)
        if isinstance(message, Estimate)
        else message
        for tick in samples.grip()
        for message in tick.messages()
    ]
    result = result_from(messages)
    assert result.model_mismatch is mismatch
    percent = None if change is None else pytest.approx(100.0 * change)
    assert result.stroke_change_percent == percent
    words = verdict(job_kinds()["grip"], result.model_dump())
    assert ("differs from its model" in words) is mismatch


def test_phases_follow_one_another_without_gaps() -> None:
    phases = result_of(samples.grip()).phases
    assert [phase.phase for phase in phases] == [name for name, *_ in samples.PHASES]
    for phase, (_, ticks, *_) in zip(phases, samples.PHASES, strict=True):
        assert phase.duration_s == pytest.approx(ticks * PERIOD_S)
    for before, after in pairwise(phases):
        assert before.start_s + before.duration_s == pytest.approx(after.start_s)


def test_a_limit_that_acted_is_named_with_its_first_sample() -> None:
    (limit,) = result_of(samples.grip()).limits_acted
    assert (limit.limit, limit.first_seq, limit.samples) == ("slew_up", 20, 5)


def test_lost_samples_are_counted_and_change_no_figure() -> None:
    ticks = samples.grip()
    result = result_of(ticks[:150] + ticks[153:])
    assert result.missed_ticks == 3
    assert result.force_error_mN == pytest.approx(samples.FORCE_ERROR_MN)


def test_a_grip_that_did_not_reach_the_hold_has_no_held_force() -> None:
    result = result_of(samples.grip()[:100])
    assert result.outcome == "unfinished"
    assert result.force_held_mN is None
    assert result.force_uncertainty_mN is None
    assert result.rmse_force_mN is None
    assert result.contact_x_um is None


def test_a_trip_is_the_outcome_whatever_the_controller_reported() -> None:
    ticks = samples.grip()
    last = ticks[-1]
    tripped = replace(last.applied, state=Mode.LATCHED, cause=Cause.ESTOP, answered=False)
    result = result_of([*ticks[:-1], replace(last, applied=tripped)])
    assert result.outcome == "tripped"
    assert result.unanswered_ticks == 1


def test_actions_in_a_result_are_listed_with_their_sample_number() -> None:
    ticks = samples.grip()
    acted = replace(ticks[180].telemetry, acted=(Acted.STOP, Acted.RELEASE), outcome=Outcome.NONE)
    ticks[180] = replace(ticks[180], telemetry=acted)
    result = result_of(ticks)
    assert [(a.type, a.seq) for a in result.actions] == [("stop", 180), ("release", 180)]


def test_without_samples_the_result_is_empty() -> None:
    result = result_of([])
    assert (result.samples, result.phases, result.outcome) == (0, [], "unfinished")


def test_every_column_names_a_field_of_its_message() -> None:
    for column in (*COLUMNS, *SECOND_COLUMNS):
        record = column.message if column.arm is None else ARMS[column.message]
        assert column.field in {field.name for field in fields(record)}


def test_a_missing_sample_leaves_a_gap_in_its_columns_only() -> None:
    tick = samples.grip()[0]
    messages: list[Message] = [m for m in tick.messages() if not isinstance(m, Applied)]
    table = columns(messages, PERIOD_S)
    assert table["voltage_V"] == [None]
    assert table["x_um"] == [tick.position.arms[0].x_um]
    assert missed(table) == 0


def test_true_values_are_assigned_to_samples_in_their_order() -> None:
    ticks = samples.grip()[:10]
    # The rig's tick count continues from an earlier job, and tick 4 wrote nothing.
    applied = [replace(t.applied, answered=t.applied.seq != 4) for t in ticks]
    written = [t for t in ticks if t.applied.seq != 4]
    truths = [replace(t.truth, seq=900 + place) for place, t in enumerate(written)]
    table = columns([*applied, *truths], PERIOD_S)
    expected = [None if t.applied.seq == 4 else t.truth.arms[0].x_um for t in ticks]
    assert table["true_x_um"] == expected


def test_ground_truth_after_a_trip_is_omitted() -> None:
    ticks = samples.grip()[:10]
    applied = [
        replace(t.applied, state="ramping" if t.applied.seq >= 7 else "armed") for t in ticks
    ]
    table = columns([*applied, *(t.truth for t in ticks)], PERIOD_S)
    assert table["true_x_um"][:7] == [t.truth.arms[0].x_um for t in ticks[:7]]
    assert table["true_x_um"][7:] == [None, None, None]
