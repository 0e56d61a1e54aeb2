"""Every motion of the feature with the stock client: holds, paths, calibrations, recipes,
pauses."""

from threading import Thread
from typing import Any

import pytest
from sila2.framework import DefinedExecutionError, SilaAnyType

from contrib.support.sila import refusal, responses, stock_client
from pincette.client import Supervisor
from tests.support.adapters import FORCE_MN, NEAR_MN, until
from tests.support.commands import pincette
from tests.support.running import Json, RunningRig

NOTHING = SilaAnyType("<DataType><Basic>String</Basic></DataType>", "")
UNKNOWN = "00000000-0000-0000-0000-000000000000"


def shares_and_samples(command: Any) -> tuple[list[float], list[Any]]:
    """Progress and samples of a command during its execution."""
    shares: list[float] = []
    samples: list[Any] = []
    for one in command.subscribe_to_intermediate_responses():
        samples.append(one.Sample)
        shares.append(command.progress or 0.0)
    return shares, samples


def test_a_held_part_can_be_held_further_and_released(rig: RunningRig, client: Any) -> None:
    gripper = client.Microgripper
    grip = responses(gripper.Grip(FORCE_MN, 0.0, ""))
    client.CancelController.CancelAll()  # nothing runs: a grip command ends when the part is held
    rig.post(f"/jobs/{grip.Job}/actions", {"type": "stop"}).raise_for_status()
    until(lambda: rig.job(grip.Job)["state"] == "stopped", "it was not stopped")
    until(lambda: gripper.Part.get() == "held", "the part is not reported as held")
    assert responses(gripper.Hold()).Job != grip.Job
    assert gripper.Part.get() == "held"
    assert responses(gripper.Release()).Outcome == "released"
    assert gripper.Part.get() == "none"
    assert refusal(gripper.Hold()).identifier == "NothingHeld"


def test_a_force_path_is_followed(rig: RunningRig, client: Any) -> None:
    track = client.Microgripper.Track("sinusoid", FORCE_MN, 4.0, 1.0, 2, "")
    shares, samples = shares_and_samples(track)
    done = responses(track)
    assert done.Outcome == "tracked"
    assert 0.0 <= done.ForceError < NEAR_MN
    assert shares == sorted(shares)
    assert max(shares) > 0.7
    forces = [sample.Force for sample in samples if sample.Phase == "track"]
    assert max(forces) - min(forces) > 2.0
    assert rig.job(done.Job)["values"]["cycles"] == 2
    too_far = refusal(client.Microgripper.Track("sinusoid", 500.0, 4.0, 1.0, 2, ""))
    assert (too_far.identifier, "limit" in too_far.message) == ("LimitViolation", True)


def test_a_calibration_proposes_values_or_states_why_not(rig: RunningRig, client: Any) -> None:
    assert pincette("rig", "part", "remove", "--rig", rig.path).returncode == 0
    try:
        calibration = client.Microgripper.Calibrate("noise")
        until(lambda: (calibration.progress or 0.0) > 0.2, "no progress is told")
        done = responses(calibration)
    finally:
        assert pincette("rig", "part", "place", "--rig", rig.path).returncode == 0
    assert calibration.progress > 0.5
    assert rig.job(done.Job)["request"]["calibration"] == "noise"
    result: Json = rig.job(done.Job)["result"]
    assert done.Proposes is bool(result.get("values"))
    assert done.Statement
    assert refusal(client.Microgripper.Calibrate("tea leaves")).identifier == "InvalidRequest"


def test_a_recipe_supplies_omitted_parameters(rig: RunningRig, client: Any) -> None:
    with Supervisor(rig.rig.supervisor.url) as supervisor:
        supervisor.save_recipe("bead", {"force_mN": 6.0, "hold_s": 0.3})
    assert client.Microgripper.Recipes.get() == ["bead"]
    assert client.Microgripper.Plan(-1.0, 0.0, "bead").Feasible is True
    done = responses(client.Microgripper.Grip(-1.0, 0.3, "bead"))
    assert abs(done.HeldForce - 6.0) < NEAR_MN
    assert rig.job(done.Job)["values"]["recipe"]["name"] == "bead"


def test_a_path_can_be_paused_and_resumed(rig: RunningRig, client: Any) -> None:
    pauses = client.PauseController
    track = client.Microgripper.Track("sinusoid", FORCE_MN, 4.0, 1.0, 4, "")
    execution = str(track.execution_uuid)
    until(lambda: rig.view()["active_job"], "no job")
    rig.until_phase(rig.view()["active_job"], "track")
    with pytest.raises(DefinedExecutionError) as caught:
        pauses.Resume(execution)
    assert caught.value.identifier == "InvalidCommandState"
    pauses.Pause(execution)
    until(
        lambda: pauses.PausedCommands.get() == [execution], "the command is not reported as paused"
    )
    assert rig.job(rig.view()["active_job"])["state"] == "paused"
    assert track.status.name == "running"
    pauses.Resume(execution)
    until(lambda: pauses.PausedCommands.get() == [], "the command is still reported as paused")
    assert responses(track).Outcome == "tracked"
    with pytest.raises(DefinedExecutionError) as caught:
        pauses.Pause(execution)
    assert caught.value.identifier == "InvalidCommandExecutionUUID"


def test_a_release_cannot_be_paused(client: Any) -> None:
    responses(client.Microgripper.Grip(FORCE_MN, 0.0, ""))
    release = client.Microgripper.Release()
    with pytest.raises(DefinedExecutionError) as caught:
        client.PauseController.Pause(str(release.execution_uuid))
    assert caught.value.identifier == "OperationNotSupported"
    responses(release)


class Misses:
    """A gripper without a part, and a client that decides about the recovery."""

    def __init__(self, rig: RunningRig, client: Any) -> None:
        self.rig, self.recovery = rig, client.ErrorRecoveryService
        self.gripper = client.Microgripper

    def missed(self) -> tuple[Any, Any]:
        """A grip that has found no part, and the error that waits for a decision."""
        grip = self.gripper.Grip(FORCE_MN, 0.0, "")
        until(lambda: self.recovery.RecoverableErrors.get() or grip.done, "no error waits")
        (one,) = self.recovery.RecoverableErrors.get()
        return grip, one


def test_a_grip_without_contact_is_retried_or_given_up(rig: RunningRig, client: Any) -> None:
    misses = Misses(rig, client)
    assert pincette("rig", "part", "remove", "--rig", rig.path).returncode == 0
    try:
        # No client has set a timeout for decisions, so the command ends with its error.
        error = refusal(client.Microgripper.Grip(FORCE_MN, 0.0, ""))
        assert error.identifier == "JobFailed"
        assert misses.recovery.RecoverableErrors.get() == []
        misses.recovery.SetErrorHandlingTimeout(60)
        grip, one = misses.missed()
        execution = str(grip.execution_uuid)
        assert one.CommandExecutionUUID == execution
        assert one.ErrorIdentifier.endswith("/JobFailed")
        assert "no part" in one.ErrorMessage
        for odd, option, refused in (
            (execution, "Pray", "UnknownContinuationOption"),
            (UNKNOWN, "Retry", "InvalidCommandExecutionUUID"),
        ):
            with pytest.raises(DefinedExecutionError) as caught:
                misses.recovery.ExecuteContinuationOption(odd, option, NOTHING)
            assert caught.value.identifier == refused
        misses.recovery.AbortErrorHandling(execution)
        assert refusal(grip).identifier == "JobFailed"
        grip, _ = misses.missed()
        client.CancelController.CancelCommand(str(grip.execution_uuid))
        assert refusal(grip).identifier == "Cancelled"
        misses.recovery.SetErrorHandlingTimeout(1)
        grip, _ = misses.missed()
        assert refusal(grip).identifier == "JobFailed"
        misses.recovery.SetErrorHandlingTimeout(60)
        grip, one = misses.missed()
    finally:
        assert pincette("rig", "part", "place", "--rig", rig.path).returncode == 0
    misses.recovery.ExecuteContinuationOption(str(grip.execution_uuid), "Retry", NOTHING)
    held = responses(grip)
    assert held.Outcome == "held"
    assert held.Job not in one.ErrorMessage
    assert len(rig.get("/jobs", label=f"sila=Grip {grip.execution_uuid}")["jobs"]) == 2
    responses(client.Microgripper.Release())


def test_a_retry_at_another_place_is_one_of_the_offered_options(
    rig: RunningRig, client: Any
) -> None:
    misses = Misses(rig, client)
    misses.recovery.SetErrorHandlingTimeout(60)
    assert pincette("rig", "part", "remove", "--rig", rig.path).returncode == 0
    try:
        grip, one = misses.missed()
        offered = {option.Identifier: option for option in one.ContinuationOptions}
        assert list(offered) == ["Retry", "RetryAt", "GiveUp"]
        execution, kind = one.CommandExecutionUUID, offered["RetryAt"].RequiredInputData
        with pytest.raises(DefinedExecutionError):
            misses.recovery.ExecuteContinuationOption(execution, "RetryAt", NOTHING)
    finally:
        assert pincette("rig", "part", "place", "--rig", rig.path).returncode == 0
    place = SilaAnyType(kind, (rig.rig.part.contact_um, 1.0))
    misses.recovery.ExecuteContinuationOption(execution, "RetryAt", place)
    held = responses(grip)
    assert held.Outcome == "held"
    assert rig.job(held.Job)["request"]["place"]["x_um"] == rig.rig.part.contact_um
    responses(client.Microgripper.Release())


TRACE = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"


def test_a_series_is_followed_through_a_decision_to_its_end(rig: RunningRig, client: Any) -> None:
    misses = Misses(rig, client)
    misses.recovery.SetErrorHandlingTimeout(60)
    misses.gripper.SetTraceContext(TRACE)
    assert pincette("rig", "part", "remove", "--rig", rig.path).returncode == 0
    try:
        series = misses.gripper.GripSeries([6.0, 8.0], 0.3, 0.0, "")
        until(lambda: misses.recovery.RecoverableErrors.get() or series.done, "no error waits")
    finally:
        assert pincette("rig", "part", "place", "--rig", rig.path).returncode == 0
    execution = str(series.execution_uuid)
    misses.recovery.ExecuteContinuationOption(execution, "Retry", NOTHING)
    seen = [(one.Ended, one.Failed) for one in series.subscribe_to_intermediate_responses()]
    done = responses(series)
    assert (done.Ended, done.Failed) == (2, 0)
    assert seen == sorted(seen)
    assert seen[-1] == (2, 0)
    found = rig.get(f"/series/{done.Series}")
    assert (found["state"], found["traceparent"]) == ("completed", TRACE)
    jobs = [rig.job(one["job"]) for one in found["jobs"]]
    assert [job["values"]["force_mN"] for job in jobs] == [6.0, 8.0]
    assert {job["traceparent"] for job in jobs} == {TRACE}
    misses.gripper.SetTraceContext("")
    assert rig.job(responses(misses.gripper.Grip(FORCE_MN, 0.3, "")).Job)["traceparent"] is None


@pytest.mark.parametrize("over", ["SiLA", "REST"])
def test_a_series_that_a_caller_stops_ends_as_cancelled(
    rig: RunningRig, client: Any, over: str
) -> None:
    series = client.Microgripper.GripSeries([FORCE_MN] * 3, 30.0, 0.0, "")
    until(lambda: rig.view()["active_job"], "no job")
    rig.until_phase(rig.view()["active_job"], "hold")
    if over == "SiLA":
        client.CancelController.CancelCommand(str(series.execution_uuid))
    else:
        (running,) = rig.get("/series", limit=1)["series"]
        rig.post(f"/series/{running['id']}/actions", {"type": "stop"})
    assert refusal(series).identifier == "Cancelled"
    (newest,) = rig.get("/series", limit=1)["series"]
    assert newest["state"] == "stopped"
    until(lambda: rig.job(newest["job"])["state"] == "stopped", "its job runs")
    responses(client.Microgripper.Release())


def test_a_series_ends_as_failed_at_its_stop_rule_and_is_refused_beyond_a_limit(
    rig: RunningRig, client: Any
) -> None:
    # An earlier test has set a longer time, which holds for all clients.
    client.ErrorRecoveryService.SetErrorHandlingTimeout(1)
    assert pincette("rig", "part", "remove", "--rig", rig.path).returncode == 0
    try:
        error = refusal(client.Microgripper.GripSeries([FORCE_MN] * 2, 0.3, 0.0, ""))
    finally:
        assert pincette("rig", "part", "place", "--rig", rig.path).returncode == 0
    assert error.identifier == "JobFailed"
    error = refusal(client.Microgripper.GripSeries([500.0], 1.0, 0.0, ""))
    assert error.identifier == "LimitViolation"


def test_two_clients_see_the_same_rig(rig: RunningRig, client: Any) -> None:
    seen: list[str] = []

    def watch() -> None:
        with stock_client(rig) as other:
            for part in other.Microgripper.Part.subscribe():
                if part != "unknown":  # no message for a second, on a busy machine
                    seen.append(part)
                if seen[-2:] == ["held", "none"]:
                    return

    watching = Thread(target=watch)
    watching.start()
    until(lambda: seen, "nothing is told")
    responses(client.Microgripper.Grip(FORCE_MN, 0.0, ""))
    until(lambda: "held" in seen, "the part is not reported as held")
    responses(client.Microgripper.Release())
    watching.join(20.0)
    assert not watching.is_alive()
