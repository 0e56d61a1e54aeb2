"""The stock clients of SiLA 2 drive a rig in lockstep, also during typical faults of a
laboratory."""

import signal
from concurrent.futures import ThreadPoolExecutor
from time import monotonic, sleep
from typing import Any, cast

import pytest
from sila2.client import SilaClient
from sila2.client.client_observable_command_instance import (
    ClientObservableCommandInstanceWithIntermediateResponses as Attached,
)
from sila2.framework import (
    DefinedExecutionError,
    InvalidMetadata,
    SilaError,
    ValidationError,
)

from contrib.support.sila import refusal, responses, stock_client
from contrib.support.stock_clients import block
from tests.support.adapters import FORCE_MN, NEAR_MN, WAIT_S, until
from tests.support.grips import restart
from tests.support.running import RunningRig


def test_a_grip_is_followed_to_its_hold_and_released(client: Any) -> None:
    gripper = client.Microgripper
    assert (gripper.Rig.get(), gripper.Reasons.get()) == ("demo", [])
    assert client.SimulationController.SimulationMode.get() is True
    plan = gripper.Plan(FORCE_MN, 0.0, "")
    assert (plan.Feasible, plan.Violations) == (True, [])
    grip = gripper.Grip(FORCE_MN, 0.0, "")
    shares: list[float] = []
    samples: list[Any] = []
    for one in grip.subscribe_to_intermediate_responses():
        samples.append(one.Sample)
        shares.append(grip.progress or 0.0)
    held = responses(grip)
    assert held.Outcome == "held"
    assert abs(held.HeldForce - FORCE_MN) < NEAR_MN
    assert 0.0 < held.ForceUncertainty < FORCE_MN
    assert {"approach", "load", "hold"} <= {sample.Phase for sample in samples}
    assert any(0.1 < share < 0.9 for share in shares)
    assert shares == sorted(shares)
    assert gripper.Part.get() == "held"
    assert 0.0 <= gripper.StateAge.get() < 1.0
    assert abs(next(iter(gripper.ContactForce.subscribe())).Force - FORCE_MN) < NEAR_MN
    assert responses(gripper.Release()).Job == held.Job
    assert gripper.Part.get() == "none"
    assert refusal(gripper.Release()).identifier == "NothingHeld"
    assert refusal(gripper.Hold()).identifier == "NothingHeld"


def test_a_grip_with_a_hold_time_ends_with_its_job(rig: RunningRig, client: Any) -> None:
    done = responses(client.Microgripper.Grip(FORCE_MN, 0.6, ""))
    assert done.Outcome == "gripped"
    assert abs(done.HeldForce - FORCE_MN) < NEAR_MN
    job = rig.job(done.Job)
    assert job["state"] == "succeeded"
    assert job["labels"]["sila"].startswith("Grip ")


def test_requests_that_break_a_limit_are_refused_as_sila_errors(client: Any) -> None:
    error = refusal(client.Microgripper.Grip(500.0, 0.0, ""))
    assert error.identifier == "LimitViolation"
    assert "force 500.000 mN above the limit 40 mN" in error.message
    plan = client.Microgripper.Plan(500.0, 0.0, "")
    assert plan.Feasible is False
    assert "500.000 mN above the limit 40 mN" in plan.Violations[0]
    with pytest.raises(ValidationError):
        client.Microgripper.Grip(FORCE_MN, 4000.0, "")
    unknown = refusal(client.Microgripper.Grip(FORCE_MN, 0.0, "no-such"))
    assert unknown.identifier == "InvalidRequest"
    for odd in (0.0, -0.5, float("nan"), float("inf")):
        try:
            found = refusal(client.Microgripper.Grip(odd, 0.0, "")).identifier
        except ValidationError:  # by the limits of the feature definition
            continue
        assert found == "InvalidRequest", odd


@pytest.mark.parametrize("pause", [False, True])
def test_a_cancel_in_a_timed_hold_ends_the_command_with_the_part_held(
    rig: RunningRig, client: Any, *, pause: bool
) -> None:
    gripper = client.Microgripper
    grip = gripper.Grip(FORCE_MN, 60.0, "")
    until(lambda: rig.view()["active_job"], "no job")
    job = rig.view()["active_job"]
    rig.until_phase(job, "hold")
    if pause:
        client.PauseController.Pause(str(grip.execution_uuid))
        until(lambda: rig.job(job)["state"] == "paused", "it does not rest")
    client.CancelController.CancelCommand(str(grip.execution_uuid))
    error = refusal(grip)
    assert error.identifier == "Cancelled"
    assert "held" in error.message
    assert gripper.Part.get() == "held"
    assert responses(gripper.Grip(FORCE_MN, 0.0, "")).Job == job  # ends at once
    assert responses(gripper.Release()).Outcome == "released"
    assert responses(gripper.Grip(FORCE_MN, 0.4, "")).Outcome == "gripped"  # at once


def test_a_release_during_a_grip_is_refused_as_busy(rig: RunningRig, client: Any) -> None:
    grip = client.Microgripper.Grip(FORCE_MN, 0.0, "")
    until(lambda: rig.view()["active_job"], "no job")
    assert refusal(client.Microgripper.Release()).identifier == "RigBusy"
    client.CancelController.CancelAll()
    assert refusal(grip).identifier == "Cancelled"


def test_a_hanging_supervisor_is_reported_as_unknown_after_a_second(
    rig: RunningRig, client: Any
) -> None:
    gripper = client.Microgripper
    until(lambda: gripper.RigState.get() != "unknown", "the supervisor does not reply")
    rig.fleet.signal("supervisor", signal.SIGSTOP)
    try:
        begun = monotonic()
        until(
            lambda: gripper.RigState.get() == "unknown",
            "the stopped supervisor is still reported as reachable",
        )
        assert monotonic() - begun < 3.0  # 1 s, plus a margin for a busy machine
        assert gripper.Part.get() == "unknown"
    finally:
        rig.fleet.signal("supervisor", signal.SIGCONT)
    until(
        lambda: gripper.RigState.get() != "unknown",
        "the supervisor is still reported as unreachable",
    )


def test_a_cancel_during_the_request_stops_it(rig: RunningRig, client: Any) -> None:
    rig.fleet.signal("supervisor", signal.SIGSTOP)
    try:
        # The request and the cancel both wait at its port when the process continues.
        grip = client.Microgripper.Grip(FORCE_MN, 0.0, "")
        sleep(0.3)
        with ThreadPoolExecutor(1) as pool:
            cancel = pool.submit(client.CancelController.CancelCommand, str(grip.execution_uuid))
            sleep(0.3)
            rig.fleet.signal("supervisor", signal.SIGCONT)
            cancel.result(20.0)
    finally:
        rig.fleet.signal("supervisor", signal.SIGCONT)
    assert refusal(grip).identifier == "Cancelled"
    label = f"sila=Grip {grip.execution_uuid}"
    assert {job["state"] for job in rig.get("/jobs", label=label)["jobs"]} <= {"stopped"}


def test_a_cancel_during_a_motion_comes_to_rest(rig: RunningRig, client: Any) -> None:
    grip = client.Microgripper.Grip(FORCE_MN, 0.0, "")
    until(lambda: rig.view()["active_job"], "no job")
    rig.until_phase(rig.view()["active_job"], "approach")
    client.CancelController.CancelAll()
    assert refusal(grip).identifier == "Cancelled"
    with pytest.raises(DefinedExecutionError) as caught:
        client.CancelController.CancelCommand(str(grip.execution_uuid))
    assert caught.value.identifier == "InvalidCommandExecutionUUID"


def test_an_emergency_stop_latches_and_is_reported(rig: RunningRig, client: Any) -> None:
    gripper = client.Microgripper
    grip = gripper.Grip(FORCE_MN, 0.0, "")
    until(lambda: rig.view()["active_job"], "no job")
    assert gripper.EmergencyStop().Cause == "estop"
    error = refusal(grip)
    assert error.identifier == "RigLatched"
    assert "estop" in error.message
    until(lambda: gripper.RigState.get() == "latched", "the latch is not reported")
    assert gripper.Reasons.get() != []
    assert refusal(gripper.Grip(FORCE_MN, 0.0, "")).identifier == "RigLatched"


def test_a_lock_prevents_grips_but_never_a_stop(rig: RunningRig, client: Any) -> None:
    gripper, locks = client.Microgripper, client.LockController

    def with_lock(word: str) -> Any:
        return [client.LockController.LockIdentifier(word)]

    assert locks.IsLocked.get() is False
    locks.LockServer("cell 7", 60)
    assert locks.IsLocked.get() is True
    with pytest.raises(InvalidMetadata):
        gripper.Grip(FORCE_MN, 0.0, "")
    stranger = gripper.Grip(FORCE_MN, 0.0, "", metadata=with_lock("cell 8"))
    # The package sila2 validates the value while the command runs; its client then receives a named
    # error.
    with pytest.raises(SilaError, match="InvalidLockIdentifier"):
        responses(stranger)
    grip = gripper.Grip(FORCE_MN, 0.0, "", metadata=with_lock("cell 7"))
    until(lambda: rig.view()["active_job"], "no job")
    assert gripper.EmergencyStop().Cause == "estop"
    assert refusal(grip).identifier == "RigLatched"
    locks.UnlockServer("cell 7")
    assert refusal(gripper.Grip(FORCE_MN, 0.0, "")).identifier == "RigLatched"


@pytest.mark.usefixtures("cleared")
def test_after_a_killed_server_the_part_stays_held_and_the_next_server_finds_the_job(
    rig: RunningRig,
) -> None:
    with stock_client(rig) as first:
        uuid = first.SiLAService.ServerUUID.get()
        grip = first.Microgripper.Grip(FORCE_MN, 0.0, "")
        execution, job = grip.execution_uuid, responses(grip).Job
    rig.fleet.signal("sila", signal.SIGKILL)
    sleep(1.0)
    assert rig.view()["part"] == "held"
    restart(rig, "sila")
    with stock_client(rig) as second:
        assert second.SiLAService.ServerUUID.get() == uuid
        until(
            lambda: second.Microgripper.RigState.get() == "armed", "the supervisor does not reply"
        )
        again = cast("Any", Attached)(second, second.Microgripper.Grip, execution)
        assert responses(again).Job == job
        assert responses(second.Microgripper.Release()).Job == job


@pytest.mark.usefixtures("cleared")
def test_the_next_server_follows_a_series_of_a_killed_one(rig: RunningRig) -> None:
    with stock_client(rig) as first:
        series = first.Microgripper.GripSeries([FORCE_MN, FORCE_MN], 0.4, 0.0, "")
        execution = series.execution_uuid
        until(lambda: rig.view()["active_job"], "no job")
    rig.fleet.signal("sila", signal.SIGKILL)
    restart(rig, "sila")
    with stock_client(rig) as second:
        until(
            lambda: second.Microgripper.RigState.get() != "unknown", "the supervisor does not reply"
        )
        again = cast("Any", Attached)(second, second.Microgripper.GripSeries, execution)
        done = responses(again)
    assert (done.Ended, done.Failed) == (2, 0)


@pytest.mark.usefixtures("cleared")
def test_the_waiting_loop_of_the_documentation_page_returns_although_the_server_was_killed(
    rig: RunningRig,
) -> None:
    found: dict[str, Any] = {}
    exec(block("docs/how-to/sila.md", "def responses").text, found)
    with stock_client(rig) as client:
        grip = client.Microgripper.Grip(FORCE_MN, 0.0, "")
        until(lambda: rig.view()["active_job"], "no job")
        rig.fleet.signal("sila", signal.SIGKILL)
        with ThreadPoolExecutor() as threads:
            waits = threads.submit(found["responses"], grip)
            sleep(1.0)
            assert not waits.done()
            restart(rig, "sila")
            held = waits.result(WAIT_S)
        assert held.Outcome == "held"
        assert found["responses"](client.Microgripper.Release()).Outcome == "released"


def test_an_unreachable_and_a_restarted_supervisor_are_reported(
    rig: RunningRig, client: Any
) -> None:
    gripper = client.Microgripper
    grip = gripper.Grip(FORCE_MN, 0.0, "")
    assert responses(grip).Outcome == "held"
    rig.fleet.signal("supervisor", signal.SIGKILL)
    until(
        lambda: gripper.RigState.get() == "unknown", "the supervisor is still reported as reachable"
    )
    assert "no answer" in gripper.Reasons.get()[0]
    assert gripper.Part.get() == "unknown"
    rig.fleet.signal("sila", signal.SIGTERM)
    restart(rig, "sila")
    until(lambda: gripper_of(rig) == "unknown", "the server did not start without its supervisor")
    restart(rig, "supervisor")
    with stock_client(rig) as later:
        until(
            lambda: later.Microgripper.RigState.get() != "unknown",
            "the supervisor is still reported as unreachable",
        )
        until(lambda: later.Microgripper.Part.get() == "held", "the part is not held")
        assert responses(later.Microgripper.Release()).Outcome == "released"


def gripper_of(rig: RunningRig) -> str:
    with SilaClient(rig.rig.sila.host, rig.rig.sila.port, insecure=True) as found:
        client: Any = found
        return client.Microgripper.RigState.get()
