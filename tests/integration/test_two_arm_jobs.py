"""Jobs of two arms by the services of the loop, with the bytes of four instruments, in lockstep.

The limits of the true values are those of the study.
"""

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from pincette.api.calibrations import CalibrationResult
from pincette.api.job_kinds import job_kinds
from pincette.api.pairs import PairResult
from pincette.api.requests import JobRequest
from pincette.api.results import JobResult
from pincette.config import RigFile, read_rig
from pincette.core.faults import FaultCode
from pincette.core.messages import Message, Reset, Status, StatusRequest, Telemetry
from pincette.core.topics import RESET, STATUS, TOPICS
from pincette.engine.arming import arm
from pincette.engine.composed import ComposedLoop
from pincette.records.columns import Columns, columns
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Present, Run, functions_of
from tests.support.two_arms import TWO_ARMS

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
FIRM_MN = 2.0


def lockstep(**simulation: Any) -> RigFile:
    rig = read_rig(TWO_ARMS)
    assert rig.simulation is not None
    return rig.model_copy(
        update={
            "rig": rig.rig.model_copy(update={"time": "lockstep"}),
            "simulation": rig.simulation.model_copy(update=simulation),
        }
    )


RIG = lockstep()


def play(body: dict[str, Any], rig: RigFile = RIG) -> tuple[JobResult, Columns, list[Message]]:
    planned = plan_job(REQUEST.validate_python(body), rig, Present())
    messages = ComposedLoop(rig).play(planned.program)
    run = Run(rig, planned, columns(messages, rig.rig.period_s), messages)
    functions = functions_of(job_kinds()[body["kind"]])
    found = functions.evaluate(run)
    return found.result, run.table, messages


def moved_um(table: Columns) -> float:
    """Return the largest displacement of the part before both arms held it, in µm."""
    places = np.array(table["true_part_um"], dtype=np.float64)
    forces = np.minimum(
        np.array(table["true_force_mN"], dtype=np.float64),
        np.array(table["true_second_force_mN"], dtype=np.float64),
    )
    held = int(np.argmax(forces >= FIRM_MN))
    assert held > 0
    return float(np.max(np.abs(places[:held] - places[0])))


@pytest.mark.parametrize(
    ("place_hz", "force_hz", "cycles", "place_percent", "force_percent"),
    [(2.0, 1.3, (10, 7), 0.5, 2.0)],
)
def test_place_and_force_each_follow_a_path(
    place_hz: float,
    force_hz: float,
    cycles: tuple[int, int],
    place_percent: float,
    force_percent: float,
) -> None:
    result, *_ = play(
        {
            "kind": "track",
            "place": {"pp_um": 8.45, "frequency_hz": place_hz, "cycles": cycles[0]},
            "force": {
                "mean_mN": 15.0,
                "pp_mN": 10.0,
                "frequency_hz": force_hz,
                "cycles": cycles[1],
            },
        }
    )
    assert isinstance(result, PairResult)
    assert result.outcome == "tracked"
    assert result.true_place_um is not None
    assert result.true_force_mN is not None
    assert result.true_place_um.rmse / 8.45 < place_percent / 100.0
    assert result.true_force_mN.rmse / 10.0 < force_percent / 100.0
    assert result.difference_mN is not None
    assert result.difference_uncertainty_mN is not None
    assert abs(result.difference_mN) < result.difference_uncertainty_mN


@pytest.mark.parametrize(("off_um", "slip_mN"), [(-5.0, 1.5), (4.0, 1.0)])
def test_a_part_off_centre_is_gripped_in_place_without_being_moved(
    off_um: float, slip_mN: float
) -> None:
    at_um = 30.85 + off_um
    assert RIG.simulation is not None
    second = RIG.simulation.second
    assert second is not None
    rig = lockstep(
        pair=RIG.simulation.pair_of_arms.model_copy(update={"ground_slip_mN": slip_mN}),
        bead_contact_um=at_um,
        second=second.model_copy(update={"bead_contact_um": 61.7 - at_um}),
    )
    result, table, _ = play({"kind": "grip", "centre": True, "hold_s": 0.5}, rig)
    assert isinstance(result, PairResult)
    assert result.outcome == "gripped"
    assert moved_um(table) < 0.5
    assert result.met_place_um == pytest.approx(off_um, abs=0.5)


@pytest.mark.parametrize("off_um", [-3.0, 3.0])
def test_both_arms_must_touch_before_they_load(off_um: float) -> None:
    """The ground lets the part be pushed, so the arms have closed on it."""
    second = RIG.simulation and RIG.simulation.second
    assert second is not None
    at_um = 30.85 + off_um
    rig = lockstep(
        bead_contact_um=at_um,
        second=second.model_copy(update={"bead_contact_um": 61.7 - at_um}),
    )
    result, table, _ = play({"kind": "grip", "hold_s": 0.5}, rig)
    assert isinstance(result, PairResult)
    assert result.outcome == "gripped"
    forces = [np.array(table[name]) for name in ("true_force_mN", "true_second_force_mN")]
    touched = [int(np.argmax(each > 0.0)) for each in forces]
    assert (touched[0] < touched[1]) is (off_um < 0.0)
    loads = table["phase"].index("load")
    assert min(float(each[loads]) for each in forces) > 0.3
    assert max(float(np.max(each[:loads])) for each in forces) < 3.0


@pytest.mark.parametrize("pull_off_mN", [(0.4, 0.1), (0.1, 0.4)])
def test_a_part_that_sticks_to_one_arm_is_released_on_the_other_first(
    pull_off_mN: tuple[float, float],
) -> None:
    assert RIG.simulation is not None
    pair = RIG.simulation.pair_of_arms.model_copy(update={"pull_off_mN": pull_off_mN})
    result, table, _ = play({"kind": "grip", "hold_s": 0.5}, lockstep(pair=pair))
    assert isinstance(result, PairResult)
    assert result.outcome == "gripped"
    pulled = [min(table[name]) for name in ("true_force_mN", "true_second_force_mN")]
    assert all(-mN - 0.05 <= least <= 0.0 for least, mN in zip(pulled, pull_off_mN, strict=True))
    assert (table["true_force_mN"][-1], table["true_second_force_mN"][-1]) == (0.0, 0.0)


@pytest.mark.parametrize(("density_kg_per_m3", "outcome"), [(2500.0, "tracked"), (2.5e5, "lost")])
def test_a_part_too_heavy_for_the_friction_of_the_arms_is_lost(
    density_kg_per_m3: float, outcome: str
) -> None:
    """At µ = 0.3 the heavy part needs 6 mN from both arms, and the path goes down to 4 mN."""
    assert RIG.simulation is not None
    assert RIG.simulation.part is not None
    update = {"friction": 0.3, "density_kg_per_m3": density_kg_per_m3, "lift_after_s": 0.1}
    part = RIG.simulation.part.model_copy(update=update)
    pair = RIG.simulation.pair_of_arms.model_copy(update={"lands": False})
    force = {"mean_mN": 8.0, "pp_mN": 8.0, "frequency_hz": 1.0, "cycles": 2}
    result, table, _ = play({"kind": "track", "force": force}, lockstep(part=part, pair=pair))
    assert isinstance(result, PairResult)
    assert result.outcome == outcome
    assert (table["true_force_mN"][-1], table["true_second_force_mN"][-1]) == (0.0, 0.0)


def test_a_part_is_gripped_carried_and_held() -> None:
    result, table, _ = play({"kind": "grip", "hold_s": 1.0, "place_um": 6.0})
    assert isinstance(result, PairResult)
    assert result.outcome == "gripped"
    assert result.held_place_um == pytest.approx(6.0, abs=0.05)
    assert result.force_held_mN == pytest.approx(15.0, abs=0.2)
    assert {"second_x_um", "second_voltage_V", "place_r_um"} <= table.keys()


def test_the_second_arm_is_calibrated_alone() -> None:
    result, table, _ = play(
        {"kind": "calibrate", "calibration": "free_response", "arm": 2}, lockstep(bead=False)
    )
    assert isinstance(result, CalibrationResult)
    assert result.outcome == "moved"
    found = {each.quantity: each.value for each in result.values}
    assert RIG.second is not None
    assert found["second.model.piezo_um_per_V"] == pytest.approx(
        RIG.second.model.piezo_um_per_V, rel=0.1
    )
    assert found["second.model.free_response"]["residual_um"] < 0.2
    assert set(table["voltage_V"]) == {0.0}


@pytest.mark.parametrize(("piezo_um_per_V", "agrees"), [(24.2, True), (27.1, False)])
def test_an_arm_with_a_wrong_response_is_reported_during_the_hold_and_in_the_result(
    piezo_um_per_V: float, agrees: bool
) -> None:
    second = RIG.simulation and RIG.simulation.second
    assert second is not None
    off = second.model_copy(update={"piezo_um_per_V": piezo_um_per_V})
    rig = lockstep(second=off)
    planned = plan_job(REQUEST.validate_python({"kind": "grip", "hold_s": 3.0}), rig)
    loop = ComposedLoop(rig)
    messages: list[Message] = []
    found: list[FaultCode] = []
    for topic in TOPICS:
        loop.bus.subscribe(topic, lambda _topic, message: messages.append(message))
    loop.bus.call(RESET, Reset(acknowledge=True))
    arm(loop.bus, planned.program, epoch=1, digest=rig.digest())
    while loop.bus.pump():
        reported = messages[-1]
        if (
            isinstance(reported, Telemetry)
            and reported.phase == "hold"
            and reported.segment_tick == 120
        ):
            status = loop.bus.call(STATUS["estimator"], StatusRequest())
            assert isinstance(status, Status)
            found = [one.code for one in status.findings]
    table = columns([m for m in messages if getattr(m, "epoch", 1) == 1], rig.rig.period_s)
    result = functions_of(job_kinds()["grip"]).evaluate(Run(rig, planned, table)).result
    assert isinstance(result, PairResult)
    assert result.forces_agree is agrees
    assert (FaultCode.FORCES_DISAGREE in found) is not agrees
