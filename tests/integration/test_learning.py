"""A track learns from cycle to cycle, in the loop and in the replay of its record."""

import dataclasses
from functools import cache

import pytest

from pincette.bus.protocol import RefusalError
from pincette.config import RigFile
from pincette.control.planning.repetition import Corrections
from pincette.control.record import replace
from pincette.core.messages import Load, Telemetry
from pincette.core.topics import LOAD
from pincette.engine.composed import ComposedLoop
from pincette.records.columns import columns
from pincette_supervisor.kinds.track import TrackJobRequest, TrackResult
from pincette_supervisor.kinds.track.functions import evaluate
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Evaluation, FaultyRequestError, Run
from tests.support.rigs import demo_rig

TRACK = TrackJobRequest(
    kind="track",
    shape="sinusoid",
    force_mean_mN=12.0,
    force_pp_mN=10.0,
    frequency_hz=2.0,
    cycles=8,
    load_s=1.0,
    learn=True,
    set="consistent",
)
"""A track with a law that leaves an error to learn: with the identified response the error is
already at the noise."""


def rig() -> RigFile:
    return demo_rig({"limits": {"slew_V_per_s": 40.0}}, time="lockstep")


def played(request: TrackJobRequest, known: Corrections | None = None) -> Evaluation:
    of = rig()
    planned = plan_job(request, of)
    assert planned.plan.violations == []
    if known is not None:
        planned = dataclasses.replace(planned, program=replace(planned.program, corrections=known))
    table = columns(ComposedLoop(of).play(planned.program), of.rig.period_s)
    return evaluate(Run(of, planned, table))


@cache
def learned() -> Evaluation:
    return played(TRACK)


def result_of(found: Evaluation) -> TrackResult:
    assert isinstance(found.result, TrackResult)
    return found.result


def errors_um(found: Evaluation) -> list[float]:
    errors = [cycle.position_um for cycle in result_of(found).cycles]
    assert None not in errors
    return [error for error in errors if error is not None]


def test_the_error_falls_from_cycle_to_cycle() -> None:
    errors = errors_um(learned())
    assert len(errors) == TRACK.cycles
    assert errors[-1] < 0.4 * errors[0]
    plain = errors_um(played(TRACK.model_copy(update={"learn": None})))
    assert errors[-1] < 0.4 * plain[-1]


def test_the_record_contains_what_the_controller_has_learned() -> None:
    found = learned()
    stored = result_of(found).learned
    assert stored is not None
    assert found.learned is not None
    assert stored.errors_um == pytest.approx(errors_um(found))
    of = rig()
    published = ComposedLoop(of).play(plan_job(TRACK, of).program)
    view = [m for m in published if isinstance(m, Telemetry) and m.correction_um]
    # The last cycle at full amplitude used all corrections except those from its own errors.
    last = view[-1].segment_tick
    assert last > 0
    largest = max(abs(m.correction_um) for m in view)
    assert largest == pytest.approx(stored.largest_um, abs=0.1)


def test_the_next_job_starts_with_what_was_learned() -> None:
    first = learned()
    again = played(TRACK, first.learned)
    assert errors_um(again)[0] < 0.5 * errors_um(first)[0]
    stored = result_of(again).learned
    assert stored is not None
    assert stored.errors_um[: len(errors_um(first))] == pytest.approx(errors_um(first))


def test_helpful_corrections_are_stored_with_figures_of_independent_cycles() -> None:
    stored = result_of(learned()).learned
    assert stored is not None
    assert stored.kept
    assert stored.before_um == pytest.approx(errors_um(learned())[0])
    assert stored.after_um is not None
    assert stored.after_um < 0.5 * errors_um(learned())[0]


@pytest.mark.parametrize("cycles", [1, 3])
def test_useless_corrections_are_not_stored(cycles: int) -> None:
    """With the identified response in the law, a slow path is at the noise level from its first
    cycle on."""
    slow = {"frequency_hz": 0.5, "cycles": cycles, "set": None}
    found = played(TRACK.model_copy(update=slow))
    stored = result_of(found).learned
    assert stored is not None
    assert not stored.kept
    assert found.learned is None
    assert (stored.after_um is None) == (cycles == 1)


def test_corrections_that_have_become_worse_are_not_stored_either() -> None:
    """Corrections from another state of the arm, as after a repair, make each cycle worse."""
    first = learned().learned
    assert first is not None
    turned = replace(first, values_um=tuple(-value for value in first.values_um), quiet=2)
    found = played(TRACK.model_copy(update={"cycles": 3}), turned)
    stored = result_of(found).learned
    assert stored is not None
    assert not stored.kept
    assert stored.after_um is not None
    assert stored.before_um is not None
    assert stored.after_um > stored.before_um


def test_a_cycle_that_is_not_a_whole_number_of_periods_is_not_used_for_learning() -> None:
    with pytest.raises(FaultyRequestError, match=r"must be a whole number; use 2\.94118 Hz"):
        plan_job(TRACK.model_copy(update={"frequency_hz": 3.0}), rig())
    steps = TrackJobRequest(kind="track", shape="step", levels_mN=[5.0, 10.0], learn=True)
    with pytest.raises(FaultyRequestError, match="only a sinusoid or a triangle has cycles"):
        plan_job(steps, rig())


def test_corrections_of_another_cycle_are_refused_before_anything_moves() -> None:
    of = rig()
    program = replace(plan_job(TRACK, of).program, corrections=Corrections((0.0,) * 7))
    with pytest.raises(RefusalError, match="7 corrections for a cycle of 25 ticks"):
        ComposedLoop(of).bus.call(LOAD, Load(program))
