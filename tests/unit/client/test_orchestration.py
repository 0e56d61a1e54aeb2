"""Interface for orchestrators: cancelled motions, the state of a rig, patience."""

import asyncio
from collections.abc import AsyncGenerator
from typing import Any

import httpx
import pytest

from pincette.api.checks import Check
from pincette.api.events import Event
from pincette.api.rig_states import RIG_STATES
from pincette.api.rigs import Rig, Standing
from pincette.client import (
    AsyncRigHandle,
    InvalidRequestError,
    JobEndedError,
    JobWaitsError,
    NoAnswerError,
    NothingHeldError,
    RigBusyError,
    RigLatchedEndError,
    RigWatch,
    Supervisor,
)
from pincette.client.call import PATIENCE_S
from pincette.client.errors import RAISED
from pincette.client.status import NEWS_S, status_of

from . import desk
from .desk import Desk

REFUSED = httpx.ConnectError("refused")
REQUESTED: dict[str, Any] = {"code": "requested", "values": {}, "problem": ""}


def event(number: int, kind: str, **body: Any) -> dict[str, Any]:
    return desk.example(Event, number=number, kind=kind, body=body)


def held_rig(**changes: Any) -> httpx.Response:
    return desk.rig(part="held", can_start=False, reasons=["job j holds a part"], **changes)


STOPPED: dict[str, Any] = {
    "state": "stopped",
    "allowed_actions": ["release"],
    "ending": REQUESTED,
    "cause": "",
}


@pytest.mark.parametrize("follow", ["to_hold", "to_success"])
def test_a_stop_in_a_hold_ends_the_command_as_cancelled(follow: str) -> None:
    # The stream of events continues as long as the part is held: nothing after the end is read.
    stream = desk.stream(
        event(1, "state", state="running"),
        event(2, "state", state="stopped"),
        event(3, "phase", phase="hold"),
        broken=True,
    )
    requested = [desk.job(), stream, held_rig(), desk.job(**STOPPED)]
    if follow == "to_success":
        requested.insert(2, desk.job(**STOPPED))
    job = Desk(*requested).supervisor().job("j")
    with pytest.raises(JobEndedError) as caught:
        list(getattr(job, follow)())
    assert (caught.value.code, caught.value.cancelled) == ("cancelled", True)
    assert "part held" in str(caught.value)
    assert "release it" in str(caught.value)


@pytest.mark.parametrize("follow", ["to_hold", "to_success"])
def test_a_job_that_waits_for_a_decision_ends_the_command(follow: str) -> None:
    wait = {"case": "no_contact", "decisions": ["retry", "give_up"], "default": "give_up"}
    waits = {"state": "awaiting_recovery", "recovery": {**wait, "until": "2026-03-01T12:01:00Z"}}
    stream = desk.stream(event(1, "state", state="awaiting_recovery"), broken=True)
    asked = [desk.job(), stream, desk.rig(), desk.job(**waits)]
    if follow == "to_success":
        asked.insert(2, desk.job(**waits))
    job = Desk(*asked).supervisor().job("j")
    with pytest.raises(JobWaitsError) as caught:
        list(getattr(job, follow)())
    assert (caught.value.code, caught.value.cancelled) == ("awaiting-recovery", False)
    recovery = caught.value.job.recovery
    assert recovery is not None
    assert recovery.decisions == ["retry", "give_up"]


def test_a_stop_caused_by_a_lease_is_a_failure() -> None:
    ending: dict[str, Any] = {**REQUESTED, "code": "lease_ended"}
    stream = desk.stream(event(1, "state", state="stopped"))
    supervisor = Desk(desk.job(), stream, held_rig(), desk.job(**{**STOPPED, "ending": ending}))
    with pytest.raises(JobEndedError) as caught:
        list(supervisor.supervisor().job("j").to_hold())
    assert (caught.value.code, caught.value.stopped) == ("job-failed", True)


def test_a_stopped_release_ends_as_cancelled() -> None:
    name = desk.example(desk.Job)["id"]
    supervisor = Desk(
        *(desk.job(), held_rig(active_job=name), desk.job()),
        *(held_rig(active_job=name), desk.job(**STOPPED)),
        *(held_rig(active_job=name), desk.job(**STOPPED)),
    )
    with pytest.raises(JobEndedError) as caught:
        list(supervisor.supervisor().job("j").to_release())
    assert caught.value.code == "cancelled"


def test_a_release_ends_once_the_next_job_can_start() -> None:
    name = desk.example(desk.Job)["id"]
    done = desk.job(state="succeeded", allowed_actions=[])
    supervisor = Desk(
        *(desk.job(), desk.rig(part="none", active_job=name), desk.job()),
        *(desk.rig(part="none", active_job=name), done),
        *(desk.rig(part="none", active_job=None), done),
    )
    list(supervisor.supervisor().job("j").to_release())
    assert supervisor.answers == []


def test_a_release_of_a_moving_job_is_refused_as_busy() -> None:
    moving = desk.job(state="running", allowed_actions=["pause", "stop", "abort"])
    supervisor = Desk(desk.rig(part="none", active_job="j"), moving)
    with pytest.raises(RigBusyError) as busy:
        supervisor.supervisor().rig("demo").let_go()
    assert busy.value.code == "job-active"
    with pytest.raises(NothingHeldError) as nothing:
        Desk(desk.rig(part="none", active_job=None)).supervisor().rig("demo").let_go()
    assert (nothing.value.code, nothing.value.status) == ("nothing-held", 409)


@pytest.mark.parametrize("odd", [float("nan"), float("inf"), float("-inf")])
def test_an_invalid_number_is_refused_by_name_before_it_is_sent(odd: float) -> None:
    supervisor = Desk()
    rig = supervisor.supervisor().rig("demo")
    for call in (rig.plan, rig.start):
        with pytest.raises(InvalidRequestError, match=r"force_mN = .* mN: must be a finite number"):
            call("grip", force_mN=odd)
    with pytest.raises(InvalidRequestError) as caught:
        rig.start("track", points=[[0.0, 1.0], [odd, 2.0]])
    assert caught.value.errors[0]["pointer"] == "/points/1/0"
    assert supervisor.asked == []


def test_every_error_has_a_code() -> None:
    assert all(raised(409, {"type": f"urn:pincette:problem:{code}"}).code == code
               for code, raised in RAISED.items())  # fmt: skip
    assert NoAnswerError("no").code == "no-answer"
    job = desk.example(desk.Job)
    assert RigLatchedEndError("no", desk.Job.model_validate(job)).code == "rig-latched"


def test_the_default_patience_is_longer_than_a_restart() -> None:
    assert Supervisor("http://127.0.0.1:9").transport.patience_s == PATIENCE_S
    supervisor = Desk(*[REFUSED] * 30, desk.rig())
    rig = supervisor.supervisor(patience_s=PATIENCE_S).rig("demo")
    assert rig.state().name == "demo"
    assert 15.0 < sum(supervisor.slept_s) < PATIENCE_S


def rig(**changes: Any) -> Rig:
    return Rig.model_validate(desk.example(Rig, **changes))


def in_state(state: str, **changes: Any) -> Rig:
    latch = {**desk.example(Rig)["latch"], "state": state}
    return rig(latch=latch, **changes)


def test_the_readiness_of_a_rig_follows_the_state_table() -> None:
    for state, entry in RIG_STATES.items():
        startable = ["grip"] if entry.may_start else []
        taken = in_state(state, active_job="j", startable=[], can_start=False)
        idle = in_state(state, active_job=None, startable=startable, can_start=entry.may_start)
        assert status_of(taken).ready == status_of(idle).ready == entry.may_start, state
    check = Check.model_validate(desk.example(Check))
    assert not status_of(rig(active_job="j", startable=[], checks=[check])).ready


def test_the_age_is_that_of_the_actuators_newest_sample() -> None:
    standing = Standing.model_validate({**desk.example(Standing), "state_age_s": 0.25})
    assert status_of(rig(standing=standing), 0.5).age_s == pytest.approx(0.75)
    unheard = standing.model_copy(update={"state_age_s": None})
    assert status_of(rig(standing=unheard)).age_s is None


def test_a_rig_without_replies_is_unknown() -> None:
    supervisor = Desk(REFUSED, httpx.ReadTimeout("late"))
    handle = supervisor.supervisor(patience_s=PATIENCE_S).rig("demo")
    for _ in range(2):
        status = handle.status()
        assert (status.state, status.part, status.ready) == ("unknown", "unknown", False)
        assert "no answer" in status.reasons[0]
    assert supervisor.slept_s == []
    limits = {one.extensions["timeout"]["read"] for one in supervisor.asked}
    assert limits == {NEWS_S}


def test_a_watched_rig_is_unknown_after_a_second_without_a_reply() -> None:
    supervisor = Desk(desk.rig(), REFUSED, desk.rig(part="held"))

    async def run() -> AsyncGenerator[tuple[str, str]]:
        async with supervisor.async_supervisor() as connected:
            now_s = [0.0]
            watch = RigWatch(AsyncRigHandle(connected.transport, "demo"), lambda: now_s[0])
            yield watch.status.state, watch.status.part
            yield (await watch.read())[:2]
            now_s[0] = NEWS_S
            yield (await watch.read())[:2]
            now_s[0] = NEWS_S + 0.01
            yield watch.status.state, watch.status.part
            yield (await watch.read())[:2]

    async def all_of_it() -> list[tuple[str, str]]:
        return [one async for one in run()]

    known = desk.example(Rig)
    newest = (known["latch"]["state"], known["part"])
    unknown = ("unknown", "unknown")
    found = asyncio.run(all_of_it())
    assert found == [unknown, newest, newest, unknown, (newest[0], "held")]
