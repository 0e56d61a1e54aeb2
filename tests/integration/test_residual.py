"""A motion is repeated without the part: the model's residual is stored and used by the next
job."""

from collections.abc import Generator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pincette.config import Calibration, RigFile, calibrated
from pincette.config.reading import laid_over
from pincette.core.messages import Message, Reset, Sample, Telemetry
from pincette.core.topics import RESET, TOPICS
from pincette.engine.arming import arm
from pincette.engine.composed import ComposedLoop
from pincette.records.columns import Columns, columns
from pincette.sim.bench import Bench
from pincette_supervisor.kinds.calibrate.requests import ResidualRequest
from pincette_supervisor.kinds.track import TrackJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.planning.prediction import played
from pincette_supervisor.planning.recorded_jobs import motion_of
from pincette_supervisor.plugin import (
    RESIDUALS,
    Evaluation,
    ModelInUse,
    Planned,
    Present,
    Run,
    functions_of,
    kind_of,
)
from pincette_supervisor.plugin.model_in_use import armed_with, merged, rig_file_alone, table_for
from tests.support.calibrating import opened_benches
from tests.support.rigs import demo_rig

TRACK = TrackJobRequest(
    kind="track", shape="sinusoid", force_mean_mN=12.0, force_pp_mN=16.0, cycles=2, load_s=1.0
)
AWAY = ResidualRequest(kind="calibrate", calibration="residual", confirm=False)


def skewed() -> RigFile:
    """Return the demo rig with an arm whose hysteresis differs from that of its model."""
    return demo_rig({"simulation": {"hysteresis": {"asymmetry": 0.1}}}, time="lockstep")


class Desk:
    """A loop that continues from job to job, as the arm does, and its bench."""

    def __init__(self, rig: RigFile) -> None:
        self.rig, self.epoch = rig, 0
        with opened_benches() as opened:
            self.loop = ComposedLoop(rig)
        self.bench: Bench = opened[-1]
        self.said: list[Message] = []
        for topic in TOPICS:
            self.loop.bus.subscribe(topic, lambda _topic, message: self.said.append(message))
        self.loop.bus.call(RESET, Reset(acknowledge=True))

    def play(self, planned: Planned) -> Columns:
        """Arm as the supervisor does, and play to the end."""
        self.said.clear()
        self.epoch += 1
        calibration = planned.armed.calibration.text()
        arm(
            self.loop.bus,
            planned.program,
            epoch=self.epoch,
            digest=self.rig.digest(),
            calibration=calibration,
        )
        while self.loop.bus.pump():
            pass
        kept = [m for m in self.said if not isinstance(m, Sample) or m.seq >= 0]
        return columns(kept, self.rig.rig.period_s)


def evaluated(desk: Desk, planned: Planned, table: Columns) -> Evaluation:
    return functions_of(kind_of(AWAY)).evaluate(Run(desk.rig, planned, table))


def residual_plan(desk: Desk, planned: Planned, table: Columns) -> Planned:
    """Return the plan of the calibration that replays a recorded job."""
    rig = desk.rig
    motion = motion_of(
        table,
        job="recorded",
        program=planned.values["program"],
        period_s=rig.rig.period_s,
        compliance_um_per_mN=rig.model.compliance_um_per_mN,
        pressed_from_mN=2.0 * rig.grip.contact_force_mN,
    )
    return plan_job(AWAY, rig_file_alone(rig), Present(recorded=motion))


def force_error_mN(table: Columns) -> float:
    """Return the r.m.s. force error (estimate minus truth) along the path, in mN."""
    rows = zip(table["phase"], table["force_mN"], table["true_force_mN"], strict=True)
    errors = [F - true for phase, F, true in rows if phase == "track" and true is not None]
    return float(np.sqrt(np.mean(np.square(errors))))


@cache
def course() -> tuple[Columns, Evaluation, Columns, Planned]:
    """Play a track, the same without the part, and a track with the stored residual."""
    desk = Desk(skewed())
    first = plan_job(TRACK, desk.rig)
    desk.play(first)
    recorded = desk.play(first)
    desk.bench.rig.remove_part()
    away = residual_plan(desk, first, recorded)
    found = evaluated(desk, away, desk.play(away))
    desk.bench.rig.place_part()
    values = {item["quantity"]: item["value"] for item in found.result.model_dump()["values"]}
    later = plan_job(TRACK, known(desk.rig, values))
    return recorded, found, desk.play(later), later


def known(rig: RigFile, values: dict[str, object]) -> ModelInUse:
    """Return the model after the proposal of a calibration has been accepted."""
    laid = merged({}, values, "2026-03-01T12:00:00Z")
    model = rig_file_alone(rig)
    calibration = Calibration(values=laid, sources=dict.fromkeys(laid, "job"))
    return replace(model, rig=calibrated(rig, calibration), calibration=calibration)


def test_a_later_job_states_a_smaller_uncertainty_of_its_force() -> None:
    recorded, found, later, planned = course()
    assert found.fault == ""
    assert planned.values["residual"]["job"] == "recorded"
    assert force_error_mN(later) < 0.6 * force_error_mN(recorded)
    stated, before = later["force_uncertainty_mN"], recorded["force_uncertainty_mN"]
    place = later["phase"].index("track")
    assert stated[place] < 0.75 * before[recorded["phase"].index("track")]


def test_the_table_is_used_for_its_own_motion_and_free_response_only() -> None:
    _, found, _, planned = course()
    rig = planned.armed.rig
    assert table_for(rig, planned.program) is not None
    other = plan_job(TRACK.model_copy(update={"cycles": 3}), planned.model)
    assert "residual" not in other.values
    assert other.armed.rig.model.residuals == ()
    assert RESIDUALS not in other.armed.calibration.sources
    free = rig.model.free_response
    assert free is not None
    changed = free.model_copy(update={"curvature_um_per_V2": 0.01})
    model = rig.model.model_copy(update={"free_response": changed})
    assert table_for(rig.model_copy(update={"model": model}), planned.program) is None
    assert found.result.outcome == "moved"


def test_the_prediction_uses_the_table_too() -> None:
    _, _, _, planned = course()
    without = replace(planned, expecting=armed_with(planned.model, None))
    with_table, bare = played(planned).samples, played(without).samples
    assert with_table.voltage_V != bare.voltage_V
    force_mN = [
        F for F, p in zip(with_table.force_mN, with_table.phase, strict=True) if p == "track"
    ]
    assert max(force_mN) == pytest.approx(20.0, abs=0.5)


def test_a_table_of_the_ringing_free_arm_is_not_stored() -> None:
    """Without a lag of the output a fast motion excites the mode, differently in free and
    pressed motion."""
    lagless = {"model": {"output_delay_s": 0.005}, "simulation": {"output_lag_s": 0.0}}
    desk = Desk(demo_rig(laid_over({"limits": {"slew_V_per_s": 40.0}}, lagless), time="lockstep"))
    first = plan_job(TRACK.model_copy(update={"frequency_hz": 2.0, "cycles": 4}), desk.rig)
    recorded = desk.play(first)
    desk.bench.rig.remove_part()
    away = residual_plan(desk, first, recorded)
    found = evaluated(desk, away, desk.play(away))
    print(found.fault)
    assert found.fault
    assert found.result.model_dump()["values"] == []


LAGLESS = {"limits": {"slew_V_per_s": 40.0}, "simulation": {"output_lag_s": 0.0}}
SKEWED = {"simulation": {"hysteresis": {"asymmetry": 0.1}}}
DRIFT = {"simulation": {"drift": {"slope_um_per_s": 0.016}}}
NOISE = {"simulation": {"sensor_noise_um": 0.15}, "sensor": {"noise_um": 0.15}}


def cover(table: Columns) -> float:
    """Return the share of the samples along the path whose true force lies within F ± U."""
    names = ("phase", "force_mN", "true_force_mN", "force_uncertainty_mN")
    rows = zip(*(table[name] for name in names), strict=True)
    within = [abs(F - true) <= u for phase, F, true, u in rows if phase == "track"]
    return sum(within) / len(within)


@pytest.mark.parametrize(
    ("arm", "frequency_hz"),
    [
        pytest.param(laid_over(SKEWED, LAGLESS), 2.0, id="skewed, no lag"),
        pytest.param(DRIFT, 0.5, id="drift"),
        pytest.param(NOISE, 2.0, id="noise"),
    ],
)
def test_a_residual_table_is_stored_only_if_it_reduces_the_error_and_u_covers_the_rest(
    arm: dict[str, dict[str, object]], frequency_hz: float
) -> None:
    """This rig states no time at which a voltage acts, so U has no term for the ringing."""
    desk = Desk(demo_rig(laid_over({"limits": {"slew_V_per_s": 40.0}}, arm), time="lockstep"))
    track = TRACK.model_copy(update={"frequency_hz": frequency_hz, "cycles": 3})
    first = plan_job(track, desk.rig)
    desk.play(first)
    recorded = desk.play(first)
    desk.bench.rig.remove_part()
    away = residual_plan(desk, first, recorded)
    found = evaluated(desk, away, desk.play(away))
    values = {item["quantity"]: item["value"] for item in found.result.model_dump()["values"]}
    print(force_error_mN(recorded), cover(recorded), found.fault)
    if not values:
        assert found.fault
        return
    desk.bench.rig.place_part()
    later = desk.play(plan_job(track, known(desk.rig, values)))
    print(force_error_mN(later), cover(later))
    assert force_error_mN(later) < force_error_mN(recorded)
    assert cover(later) > min(0.9, cover(recorded)) - 0.05


def test_if_the_part_is_still_present_the_run_ends_and_nothing_is_stored() -> None:
    desk = Desk(demo_rig(time="lockstep"))
    first = plan_job(TRACK, desk.rig)
    recorded = desk.play(first)
    away = residual_plan(desk, first, recorded)
    table = desk.play(away)
    assert "contact" in table["outcome"]
    found = evaluated(desk, away, table)
    assert found.result.model_dump()["values"] == []


def test_the_same_table_gives_the_same_bits() -> None:
    _, _, later, planned = course()

    def again() -> Generator[Telemetry]:
        desk = Desk(skewed())
        desk.play(planned)
        yield from (m for m in desk.said if isinstance(m, Telemetry))

    assert list(again()) == list(again())
    assert len(later["seq"]) > 400
