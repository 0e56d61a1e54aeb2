"""A motion has reached the requested force, or ends with an error that states both forces."""

import json
from typing import Any

import pytest

from pincette.api.events import Event
from pincette.api.jobs import Job, Progress
from pincette.client import ForceNotReachedError, JobEndedError, PartHeldError, kept_at_rest

from . import desk
from .desk import Desk

ASKED_MN = 15.0
VALUES = {"force_mN": ASKED_MN, "hold_s": None}
REQUESTED: dict[str, Any] = {"code": "requested", "values": {}, "problem": ""}
RELEASE = {"type": "release", "requested_at": "a", "by": "b", "applied_at": "c", "seq": 9}
STOPPED: dict[str, Any] = {
    "state": "stopped",
    "values": VALUES,
    "allowed_actions": ["release"],
    "ending": REQUESTED,
    "cause": "",
}


def event(number: int | None, kind: str, **body: Any) -> dict[str, Any]:
    return desk.example(Event, number=number, kind=kind, body=body)


def progress(phase: str, **changes: Any) -> dict[str, Any]:
    body = desk.example(Progress, phase=phase, force_held_mN=None, force_uncertainty_mN=0.1)
    return event(None, "progress", **{**body, **changes})


def stopped_with(phase: str, force_mN: float) -> Desk:
    """Return a supervisor whose job is stopped in a phase, and keeps its part where it has one."""
    held = force_mN > 0.0
    kept = {"force_mN": force_mN, "force_held_mN": force_mN if phase == "hold" else None}
    newest = desk.example(Progress, phase="stopped", force_mN=force_mN, held=held)
    stream = desk.stream(
        event(1, "state", state="running"),
        progress(phase, force_mN=force_mN),
        event(2, "state", state="stopping"),
        # The hold of a stop, as an older supervisor reports it: it is never counted.
        progress("hold" if held else "stopping", **{**kept, "force_held_mN": force_mN}),
        event(3, "state", state="stopped"),
        broken=True,
    )
    end = desk.job(**STOPPED, progress=newest)
    rig = desk.rig(part="held" if held else "none", can_start=False, reasons=["held"])
    return Desk(desk.job(state="running", values=VALUES), stream, rig, end)


@pytest.mark.parametrize(
    ("phase", "force_mN"),
    [
        ("approach", 0.0),
        ("contact", 0.0),
        ("load", 7.5),
        ("settle", 14.9),
        ("hold", 15.0),
        ("unload", 5.0),
    ],
)
def test_a_stopped_grip_has_not_reached_its_force(phase: str, force_mN: float) -> None:
    job = stopped_with(phase, force_mN).supervisor().job("j")
    with pytest.raises(JobEndedError) as caught:
        list(job.to_hold())
    assert (caught.value.code, caught.value.asked_mN) == ("cancelled", ASKED_MN)
    assert caught.value.force_mN == (force_mN or None)
    if force_mN:
        assert f"{force_mN:.2f} of 15 mN" in str(caught.value)


def holding(held_mN: float, elapsed_s: float, **changes: Any) -> dict[str, Any]:
    return progress("hold", force_held_mN=held_mN, elapsed_s=elapsed_s, **changes)


def following(*moments: dict[str, Any], **job: Any) -> Desk:
    stream = desk.stream(event(1, "state", state="running"), *moments, broken=True)
    return Desk(desk.job(state="running", **{"values": VALUES, **job}), stream)


@pytest.mark.parametrize(
    ("held_mN", "request_", "uncertainty_mN", "reached"),
    [
        (14.8, {}, 0.1, True),
        (14.6, {}, 0.1, False),
        (14.6, {}, 0.5, True),
        (14.8, {"force_tolerance_mN": 0.1}, 0.5, False),
    ],
)
def test_a_force_is_reached_within_its_tolerance(
    held_mN: float, request_: dict[str, Any], uncertainty_mN: float, reached: bool
) -> None:
    moments = [
        holding(held_mN, at_s, force_uncertainty_mN=uncertainty_mN) for at_s in (9.0, 13.9, 14.1)
    ]
    job = following(*moments, request={"kind": "grip", **request_}).supervisor().job("j")
    if reached:
        assert [now.elapsed_s for now in job.to_hold()] == [9.0]
        return
    with pytest.raises(ForceNotReachedError) as caught:
        list(job.to_hold())
    assert (caught.value.force_mN, caught.value.asked_mN) == (held_mN, ASKED_MN)
    assert (caught.value.code, caught.value.cancelled) == ("force-not-reached", False)
    assert caught.value.codes["force_mN"] == held_mN


def test_waiting_for_the_hold_continues_until_the_force_is_within_its_tolerance() -> None:
    job = following(holding(14.0, 9.0), holding(14.95, 10.0)).supervisor().job("j")
    assert [now.elapsed_s for now in job.to_hold()] == [9.0, 10.0]


def test_a_job_without_a_requested_force_holds_when_its_phase_is_hold() -> None:
    moments = (progress("approach"), progress("hold", force_mN=None))
    job = following(*moments, kind="hold", values={"hold_s": None}).supervisor().job("j")
    assert [now.phase for now in job.to_hold()] == ["approach", "hold"]


@pytest.mark.parametrize(
    ("result", "reached"),
    [
        ({"outcome": "gripped", "force_held_mN": 14.9, "force_uncertainty_mN": 0.1}, True),
        ({"outcome": "gripped", "force_held_mN": None, "force_uncertainty_mN": None}, True),
        ({"outcome": "gripped", "force_held_mN": 12.0, "force_uncertainty_mN": 0.1}, False),
        ({"outcome": "moved"}, True),
        (None, True),
        ({"outcome": "released", "force_held_mN": None, "force_uncertainty_mN": None}, True),
        ("let go", False),
    ],
)
def test_a_job_succeeds_with_the_requested_force(
    result: dict[str, Any] | str | None, reached: bool
) -> None:
    stream = desk.stream(event(1, "state", state="succeeded"))
    ended: dict[str, Any] = {"state": "succeeded", "values": VALUES, "result": result}
    if result == "let go":
        ended |= {"actions": [RELEASE], "result": {"outcome": "released", "force_held_mN": None}}
    supervisor = Desk(desk.job(values=VALUES), stream, desk.job(**ended))
    job = supervisor.supervisor().job("j")
    if reached:
        list(job.to_success())
        return
    with pytest.raises(ForceNotReachedError):
        list(job.to_success())


@pytest.mark.parametrize("released", [True, False])
def test_another_job_of_the_rig_does_not_count_as_a_release(released: bool) -> None:
    ended: dict[str, Any] = {
        **STOPPED,
        "allowed_actions": [],
        "actions": [RELEASE] if released else [],
    }
    taken = desk.rig(part="held", active_job="other")
    supervisor = Desk(desk.job(**ended), taken, desk.job(**ended), taken, desk.job(**ended))
    job = supervisor.supervisor().job("j")
    if released:
        list(job.to_release())
        return
    with pytest.raises(JobEndedError):
        list(job.to_release())


def test_a_part_that_is_held_is_named_with_its_job_and_force() -> None:
    held = {"job": "j", "labels": {"cell": "7"}, "force_mN": 14.9}
    supervisor = Desk(desk.problem(409, "part-held", **held))
    with pytest.raises(PartHeldError) as caught:
        supervisor.supervisor().rig("demo").start("grip", force_mN=ASKED_MN)
    found = caught.value
    assert {"job": found.job, "labels": found.labels, "force_mN": found.force_mN} == held
    assert found.codes == {"code": "part-held", "violations": [], "errors": [], **held}


def test_a_part_without_a_job_is_reported() -> None:
    found = PartHeldError(409, {"type": "urn:pincette:problem:part-held", "title": "held"})
    assert (found.job, found.labels, found.force_mN) == (None, {}, None)


IN_HOLD: dict[str, Any] = {"state": "running", "values": VALUES, "allowed_actions": ["release"]}
KEPT: dict[str, Any] = {"state": "stopped", "values": VALUES, "allowed_actions": ["release"]}


@pytest.mark.parametrize(
    ("job", "now", "held"),
    [
        (IN_HOLD, {"phase": "hold", "force_mN": 15.0, "force_r_mN": 15.0}, False),
        (KEPT, {"phase": "hold", "force_held_mN": 14.0, "force_r_mN": 15.0}, False),
        (KEPT, {"phase": "stopped", "force_mN": 14.9, "force_r_mN": 15.0}, True),
        (KEPT, {"phase": "stopped", "force_mN": 7.6, "force_r_mN": 7.5}, False),
        # A load that passes through the force does not hold it.
        (KEPT, {"phase": "stopped", "force_mN": 15.0, "force_r_mN": 7.5}, False),
        ({**KEPT, "allowed_actions": []}, {"force_mN": 15.0, "force_r_mN": 15.0}, False),
        (KEPT, {"held": False, "force_mN": 15.0, "force_r_mN": 15.0}, False),
    ],
)
def test_a_stopped_job_that_keeps_a_force_is_recognized(
    job: dict[str, Any], now: dict[str, Any], held: bool
) -> None:
    newest = {"held": True, "force_held_mN": None, "force_uncertainty_mN": 0.1, **now}
    found = Job.model_validate(desk.example(Job, **job, progress=desk.example(Progress, **newest)))
    assert (kept_at_rest(found, ASKED_MN) is not None) == held


OWN: dict[str, Any] = {"labels": {"cell": "7"}, "allowed_actions": ["release"]}
HOLDS_5: dict[str, Any] = {"phase": "hold", "force_mN": 5.0, "force_r_mN": 5.0}


@pytest.mark.parametrize(
    ("active", "now", "hold_s", "started"),
    [
        (None, {}, None, "grip"),
        ({**OWN, "state": "running", "values": {"force_mN": 5.0}}, HOLDS_5, None, "hold"),
        ({**OWN, "state": "stopped", "values": VALUES}, HOLDS_5, None, "hold"),
        ({**OWN, "state": "stopped", "values": VALUES}, {"force_r_mN": 15.0}, None, ""),
        ({**OWN, "state": "stopped", "values": VALUES}, {"force_r_mN": 15.0}, 2.0, "hold"),
        ({**OWN, "state": "running", "values": VALUES}, {"phase": "load"}, None, ""),
        ({**OWN, "state": "running", "values": VALUES}, {"phase": "unload"}, None, "grip"),
        ({**OWN, "state": "running", "values": {"hold_s": 9.0}}, {"phase": "hold"}, None, "grip"),
        ({**OWN, "state": "paused", "values": VALUES}, {"force_r_mN": 15.0}, None, ""),
        ({**OWN, "state": "paused", "values": {"hold_s": 9.0}}, {"force_r_mN": 15.0}, None, "hold"),
        ({**OWN, "state": "paused", "values": VALUES}, HOLDS_5, None, "hold"),
        ({**OWN, "state": "stopped", "labels": {"cell": "8"}}, HOLDS_5, None, "grip"),
    ],
)
def test_a_new_force_is_reached_from_a_part_that_the_same_client_holds(
    active: dict[str, Any] | None, now: dict[str, Any], hold_s: float | None, started: str
) -> None:
    newest = {"held": True, "force_mN": 15.0, "force_uncertainty_mN": 0.1, **now}
    answers = [desk.rig(active_job=None if active is None else "j")]
    if active is not None:
        progress = desk.example(Progress, force_held_mN=None, **newest)
        answers.append(desk.job(id="j", progress=progress, **active))
    supervisor = Desk(*answers, desk.job(id="new"))
    rig = supervisor.supervisor().rig("demo")
    job, kept = rig.reach(ASKED_MN, own=("cell", "7"), hold_s=hold_s, labels={"cell": "7"})
    assert job.id == ("new" if started else "j")
    assert (kept is not None) == (not started and job.state in ("stopped", "paused"))
    if not started:
        return
    body = json.loads(supervisor.asked[-1].content)
    held = {"until_released": True} if hold_s is None else {"hold_s": hold_s}
    expected = {"kind": started, "force_mN": ASKED_MN, "labels": {"cell": "7"}, **held}
    assert expected.items() <= body.items()


def test_a_paused_job_of_the_same_client_without_a_part_is_stopped_before_the_grip() -> None:
    free: dict[str, Any] = {"progress": None, "allowed_actions": ["resume", "stop", "abort"]}
    paused = {**OWN, **free, "id": "j", "state": "paused", "values": VALUES}
    ended = desk.job(**{**paused, "state": "stopped"}, ended_at="now")
    supervisor = Desk(desk.rig(active_job="j"), desk.job(**paused), ended, desk.job(id="new"))
    rig = supervisor.supervisor().rig("demo")
    job, kept = rig.reach(ASKED_MN, own=("cell", "7"))
    assert (job.id, kept) == ("new", None)
    assert json.loads(supervisor.asked[-2].content)["type"] == "stop"
    assert json.loads(supervisor.asked[-1].content)["kind"] == "grip"
