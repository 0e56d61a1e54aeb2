"""A real RunEngine drives a rig in lockstep; its documents are validated by the schemas of
event-model."""

import math
import signal
import subprocess
import sys
from collections.abc import Generator
from threading import Thread, Timer
from time import sleep
from typing import Any, cast

import pytest
from bluesky.run_engine import WaitForTimeoutError
from bluesky.suspenders import SuspendBoolLow
from bluesky.utils import FailedStatus, RunEngineInterrupted
from ophyd_async.core import NotConnectedError

from contrib.support.run_engine import (
    bpp,
    bps,
    check_limits,
    closed,
    connected,
    ended,
    failure,
    new_engine,
    of,
    subscribed,
    until_moving,
)
from pincette.api.jobs import Job, Progress
from pincette.api.rigs import Rig
from pincette.client import (
    InfeasiblePlanError,
    InvalidRequestError,
    JobEndedError,
    LimitViolationError,
    PartHeldError,
    RigBusyError,
    RigLatchedEndError,
    RigLatchedError,
)
from pincette_bluesky import Gripper
from pincette_bluesky.readings import setpoint_mN
from tests.support.adapters import FORCE_MN, NEAR_MN, SLOWLY, adapter_rig, until
from tests.support.grips import make_ready, reset, restart
from tests.support.running import RunningRig

FLIGHT: dict[str, Any] = {"kind": "grip", "force_mN": FORCE_MN, "hold_s": 0.4}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    with adapter_rig(tmp_path_factory.mktemp("rig"), SLOWLY) as running:
        yield running


@pytest.fixture(scope="module")
def engine() -> Generator[Any]:
    engine = new_engine()
    yield engine
    ended(engine)


@pytest.fixture
def documents(engine: Any) -> Generator[list[tuple[str, Any]]]:
    seen: list[tuple[str, Any]] = []
    token = subscribed(engine, seen)
    yield seen
    engine.unsubscribe(token)


@pytest.fixture
def gripper(rig: RunningRig, engine: Any) -> Generator[Gripper]:
    assert engine.state == "idle"
    make_ready(rig)
    device = connected(rig.rig.supervisor.url)
    yield device
    if engine.state != "idle":
        engine.abort()
    closed(engine, device)
    if rig.view()["part"] == "held":
        rig.post("/jobs/" + rig.view()["active_job"] + "/actions", {"type": "release"})
    until(lambda: rig.view()["active_job"] is None, "a job is left")


def located(engine: Any, gripper: Gripper) -> float:
    """Return the setpoint that a plan reads."""
    found: list[float] = []

    def plan() -> Generator[Any, Any, None]:
        place = cast("Any", (yield from bps.locate(gripper)))
        found.append(place["setpoint"])

    engine(plan())
    return found[0]


def test_a_part_is_gripped_read_and_released(
    engine: Any, gripper: Gripper, documents: list[tuple[str, Any]], rig: RunningRig
) -> None:
    updates: list[dict[str, Any]] = []

    def watched(**update: Any) -> None:
        updates.append(update)

    @bpp.run_decorator()
    def plan() -> Generator[Any, Any, None]:
        status = cast("Any", (yield from bps.abs_set(gripper, FORCE_MN, group="grip")))
        status.watch(watched)
        yield from bps.wait("grip")
        yield from bps.trigger_and_read([gripper])
        # The plan is rewound after a pause: a part that is already held stays held.
        yield from bps.mv(gripper, FORCE_MN)
        yield from bps.mv(gripper, 0.0)
        yield from bps.mv(gripper, 0.0)
        yield from bps.trigger_and_read([gripper])

    engine(plan())
    (descriptor,) = of(documents, "descriptor")
    assert descriptor["data_keys"]["gripper-force_mN"]["units"] == "mN"
    assert descriptor["hints"]["gripper"]["fields"] == ["gripper-force_mN"]
    assert descriptor["configuration"]["gripper"]["data"]["gripper-rig"] == "demo"
    held, free = (event["data"] for event in of(documents, "event"))
    assert abs(held["gripper-force_mN"] - FORCE_MN) < NEAR_MN
    assert (held["gripper-part"], free["gripper-part"]) == ("held", "none")
    assert of(documents, "stop")[0]["exit_status"] == "success"
    assert {update["unit"] for update in updates} == {"mN"}
    assert updates[-1]["current"] == pytest.approx(FORCE_MN, abs=NEAR_MN)
    assert any(update.get("time_remaining", 0.0) > 0.0 for update in updates)
    begun = [job["kind"] for job in rig.get("/jobs", label="bluesky=gripper")["jobs"]]
    assert begun == ["grip"], "a second job was started"


def test_a_part_stays_held_from_one_plan_to_the_next(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    engine(bps.mv(gripper, FORCE_MN))  # the engine calls stop at its end
    job = rig.view()["active_job"]
    sleep(0.5)
    assert (rig.view()["part"], rig.job(job)["state"]) == ("held", "running")
    engine(bps.mv(gripper, FORCE_MN))
    assert rig.view()["active_job"] == job
    assert located(engine, gripper) == FORCE_MN
    engine(bps.mvr(gripper, 0.0))
    assert (rig.view()["part"], rig.view()["active_job"]) == ("held", job)
    assert isinstance(failure(engine, bps.mvr(gripper, 100.0)), LimitViolationError)
    assert located(engine, gripper) == FORCE_MN
    engine(bps.mvr(gripper, 3.0))
    assert located(engine, gripper) == FORCE_MN + 3.0
    rig.post(f"/jobs/{rig.view()['active_job']}/actions", {"type": "release"})
    until(lambda: rig.view()["active_job"] is None, "the part is not released")
    job = rig.start_grip(force_mN=FORCE_MN, until_released=True, labels={"cell": "7"})
    rig.until_phase(job, "hold")
    held = failure(engine, bps.mv(gripper, FORCE_MN - 2.0))
    assert isinstance(held, PartHeldError)
    assert (held.job, held.labels) == (job, {"cell": "7"})
    engine(bps.mv(gripper, 0.0))
    assert rig.view()["part"] == "none"
    assert located(engine, gripper) == 0.0


def test_a_force_that_a_stopped_job_holds_is_reached_at_once(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    engine(bps.mv(gripper, FORCE_MN))
    job = rig.view()["active_job"]
    rig.post(f"/jobs/{job}/actions", {"type": "stop"}).raise_for_status()
    until(lambda: rig.job(job)["state"] == "stopped", "the job is not stopped")
    assert located(engine, gripper) == pytest.approx(FORCE_MN)
    engine(bps.mv(gripper, FORCE_MN))
    assert rig.view()["active_job"] == job
    engine(bps.mv(gripper, 0.0))
    assert rig.view()["part"] == "none"


@pytest.mark.parametrize(
    ("changes", "progress", "setpoint"),
    [
        ({}, {"phase": "load"}, 15.0),
        ({}, {"phase": "hold"}, 15.0),
        ({}, {"phase": "unload"}, math.nan),
        ({"values": {"hold_s": None}}, {"phase": "hold"}, math.nan),
        ({"state": "stopped", "ended_at": "then"}, {"phase": "stopped", "force_r_mN": 7.5}, 7.5),
        ({"state": "stopped", "ended_at": "then"}, {"held": False}, math.nan),
    ],
)
def test_the_setpoint_is_the_requested_force_of_the_active_job(
    changes: dict[str, Any], progress: dict[str, Any], setpoint: float
) -> None:
    newest = {**example(Progress), **progress}
    fields = {"values": {"force_mN": 15.0}, **changes, "progress": newest}
    job = Job.model_validate({**example(Job), **fields})
    held = Rig.model_validate({**example(Rig), "part": "held"})
    assert setpoint_mN(held, job) == pytest.approx(setpoint, nan_ok=True)
    assert math.isnan(setpoint_mN(held, None))
    free = Rig.model_validate({**example(Rig), "part": "none"})
    assert setpoint_mN(free, None) == 0.0


def example(model: Any) -> dict[str, Any]:
    """Return the example of a model."""
    return model.model_config["json_schema_extra"]["examples"][0]


def test_a_flight_gives_the_samples_of_its_record(
    engine: Any, gripper: Gripper, documents: list[tuple[str, Any]]
) -> None:
    @bpp.run_decorator()
    def plan() -> Generator[Any, Any, None]:
        yield from bps.prepare(gripper, FLIGHT, wait=True)
        yield from bps.declare_stream(gripper, name="gripper_samples", collect=True)
        yield from bps.kickoff(gripper, wait=True)
        yield from bps.complete(gripper, wait=True)
        yield from bps.collect(gripper, name="gripper_samples")

    engine(plan())
    (descriptor,) = of(documents, "descriptor")
    assert descriptor["name"] == "gripper_samples"
    assert descriptor["data_keys"]["gripper-x_um"]["units"] == "µm"
    pages = of(documents, "event_page")
    data = pages[0]["data"]
    assert {"approach", "load", "hold", "retreat"} <= set(data["gripper-phase"])
    held = [
        force_mN
        for phase, force_mN in zip(data["gripper-phase"], data["gripper-force_mN"], strict=True)
        if phase == "hold"
    ]
    assert held[-1] == pytest.approx(FORCE_MN, abs=NEAR_MN)
    times = [at_s for page in pages for at_s in page["time"]]
    assert times == sorted(times)
    assert all(not math.isnan(at_s) for at_s in times)
    assert of(documents, "stop")[0]["num_events"] == {"gripper_samples": len(times)}


def test_requests_that_break_a_limit_are_refused_with_value_unit_and_limit(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    words = "force 500.000 mN above the limit 40 mN"
    error = failure(engine, bps.mv(gripper, 500.0))
    assert isinstance(error, LimitViolationError)
    assert words in str(error)
    planned = failure(engine, bps.prepare(gripper, {**FLIGHT, "force_mN": 500.0}, wait=True))
    assert isinstance(planned, InfeasiblePlanError)
    assert words in str(planned)

    check_limits(bps.mv(gripper, FORCE_MN))
    with pytest.raises(InfeasiblePlanError, match="limit 40 mN"):
        check_limits(bps.mv(gripper, 500.0))
    with pytest.raises(FailedStatus):
        engine(bps.prepare(gripper, {**FLIGHT, "until_released": True}, wait=True))
    assert rig.view()["active_job"] is None


@pytest.mark.parametrize("odd", [math.nan, math.inf, -1.0, "20", None, True])
def test_the_refusal_of_an_invalid_force_names_the_parameter(
    engine: Any, gripper: Gripper, rig: RunningRig, odd: Any
) -> None:
    error = failure(engine, bps.mv(gripper, odd))
    assert isinstance(error, InvalidRequestError)
    assert "force_mN" in str(error)
    assert engine(bps.locate(gripper)) is not None
    assert rig.view()["active_job"] is None


def test_a_release_during_another_clients_grip_is_an_error(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    job = rig.start_grip(force_mN=FORCE_MN, until_released=True)
    rig.until_phase(job, "approach")
    assert isinstance(failure(engine, bps.mv(gripper, 0.0)), RigBusyError)
    rig.post(f"/jobs/{job}/actions", {"type": "stop"}).raise_for_status()
    assert rig.ended(job)["state"] == "stopped"


def test_an_abort_in_the_hold_of_a_flight_keeps_the_part(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    @bpp.stage_decorator([gripper])
    @bpp.run_decorator()
    def plan() -> Generator[Any, Any, None]:
        yield from bps.prepare(gripper, {**FLIGHT, "hold_s": 60.0}, wait=True)
        yield from bps.checkpoint()
        yield from bps.kickoff(gripper, wait=True)
        while rig.phase() != "hold":
            yield from bps.sleep(0.05)
        yield from bps.pause()
        yield from bps.complete(gripper, wait=True)

    with pytest.raises(RunEngineInterrupted):
        engine(plan())
    job = rig.get("/jobs", label="bluesky=gripper", limit=1)["jobs"][0]["id"]
    engine.abort()
    until(lambda: rig.job(job)["state"] == "stopped", "it goes on")
    assert rig.view()["part"] == "held"
    engine(bps.mv(gripper, 0.0))
    assert rig.view()["part"] == "none"


def test_an_abort_during_a_motion_comes_to_rest(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    @bpp.stage_decorator([gripper])
    @bpp.run_decorator()
    def plan() -> Generator[Any, Any, None]:
        yield from bps.prepare(gripper, FLIGHT, wait=True)
        yield from bps.checkpoint()
        yield from bps.kickoff(gripper, wait=True)
        yield from bps.pause()
        yield from bps.complete(gripper, wait=True)

    with pytest.raises(RunEngineInterrupted):
        engine(plan())
    job = rig.get("/jobs", label="bluesky=gripper", limit=1)["jobs"][0]["id"]
    engine.abort()
    assert rig.ended(job)["state"] == "stopped"
    assert rig.view()["part"] == "none"


def test_a_pause_during_the_request_stops_it_and_a_resume_grips(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    @bpp.run_decorator()
    def plan() -> Generator[Any, Any, None]:
        yield from bps.checkpoint()
        yield from bps.mv(gripper, FORCE_MN)

    before = rig.get("/jobs", label="bluesky=gripper")["jobs"]
    rig.fleet.signal("supervisor", signal.SIGSTOP)
    Timer(0.5, engine.request_pause).start()
    Timer(1.0, rig.fleet.signal, ("supervisor", signal.SIGCONT)).start()
    with pytest.raises(RunEngineInterrupted):
        engine(plan())
    until(lambda: rig.view()["active_job"] is None, "the request went on")
    engine.resume()
    assert rig.view()["part"] == "held"
    begun = rig.get("/jobs", label="bluesky=gripper")["jobs"][: -len(before) or None]
    assert {job["state"] for job in begun} <= {"running", "stopped"}
    engine(bps.mv(gripper, 0.0))


def test_cancelling_a_waiting_plan_stops_the_motion(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    def plan() -> Generator[Any, Any, None]:
        yield from bps.abs_set(gripper, FORCE_MN, group="grip")
        yield from until_moving(rig)
        yield from bps.wait("grip", timeout=0.1)

    with pytest.raises(WaitForTimeoutError):
        engine(plan())
    until(lambda: rig.view()["active_job"] is None, "the motion goes on")
    assert rig.view()["part"] == "none"


def test_an_emergency_stop_and_the_latch_are_reported(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    def plan() -> Generator[Any, Any, None]:
        yield from bps.abs_set(gripper, FORCE_MN, group="grip")
        yield from until_moving(rig)
        rig.post("/rigs/demo/estop").raise_for_status()
        yield from bps.wait("grip")

    error = failure(engine, plan())
    assert isinstance(error, RigLatchedEndError)
    assert "estop" in str(error)
    until(lambda: rig.view()["latch"]["state"] == "latched", "the rig did not come to rest")
    assert isinstance(failure(engine, bps.mv(gripper, FORCE_MN)), RigLatchedError)


@pytest.mark.parametrize("before", [True, False], ids=["before", "within"])
def test_a_suspender_waits_until_the_rig_accepts_commands(
    engine: Any, gripper: Gripper, rig: RunningRig, before: bool
) -> None:
    suspender: Any = SuspendBoolLow(gripper.ready)
    engine.install_suspender(suspender)

    def stop() -> None:
        rig.post("/rigs/demo/estop").raise_for_status()
        until(lambda: rig.view()["latch"]["state"] == "latched", "it is not latched")
        until(lambda: suspender.tripped, "the suspender does not notice the latch")

    def look_and_reset() -> None:
        if not before:
            stop()
        sleep(0.5)
        reset(rig)

    def plan() -> Generator[Any, Any, None]:
        yield from bps.checkpoint()
        if not before:
            yield from bps.sleep(3.0)  # the suspender interrupts it
        yield from bps.mv(gripper, FORCE_MN)

    person = Thread(target=look_and_reset)
    try:
        if before:
            stop()
        person.start()
        engine(plan())
    finally:
        person.join()
        engine.remove_suspender(suspender)
    assert rig.view()["part"] == "held"
    engine(bps.mv(gripper, 0.0))


def test_a_stop_by_another_client_is_an_error(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    def plan() -> Generator[Any, Any, None]:
        yield from bps.abs_set(gripper, FORCE_MN, group="grip")
        yield from until_moving(rig)
        rig.post(f"/jobs/{rig.view()['active_job']}/actions", {"type": "stop"})
        yield from bps.wait("grip")

    error = failure(engine, plan())
    assert isinstance(error, JobEndedError)
    assert error.stopped


KILLED = """\
import sys, time
import bluesky.plan_stubs as bps
from bluesky.run_engine import RunEngine
from ophyd_async.core import init_devices
from pincette_bluesky import Gripper

engine = RunEngine({}, context_managers=[])
with init_devices():
    gripper = Gripper(sys.argv[1])
engine(bps.mv(gripper, float(sys.argv[2])))
print("held", flush=True)
time.sleep(60.0)
"""


def test_after_a_killed_process_the_part_stays_held_and_the_next_process_finds_its_job(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    line = [sys.executable, "-c", KILLED, rig.rig.supervisor.url, str(FORCE_MN)]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        process.kill()
    sleep(0.5)
    job = rig.view()["active_job"]
    assert rig.view()["part"] == "held"
    engine(bps.mv(gripper, FORCE_MN))
    assert rig.view()["active_job"] == job
    engine(bps.mv(gripper, 0.0))
    assert rig.view()["part"] == "none"


def test_a_restarted_supervisor_leaves_the_part_held(
    engine: Any, gripper: Gripper, rig: RunningRig
) -> None:
    engine(bps.mv(gripper, FORCE_MN))
    rig.fleet.signal("supervisor", signal.SIGKILL)
    rig.fleet.members["supervisor"].process.wait(5.0)
    with pytest.raises(NotConnectedError):
        connected(rig.rig.supervisor.url, timeout_s=0.5)
    restart(rig, "supervisor")
    until(lambda: rig.view()["part"] == "held", "the part is not held")
    engine(bps.mv(gripper, 0.0))
    assert rig.view()["part"] == "none"
