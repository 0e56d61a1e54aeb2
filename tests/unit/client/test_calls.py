"""Requests of a client, its handling of replies, and its retries."""

import asyncio
import json

import httpx
import pytest

from pincette.api.jobs import Job
from pincette.api.plans import Plan
from pincette.api.problems import REMEDIES
from pincette.cli.bring_up import path_warnings
from pincette.client import ForeignAnswerError, NoAnswerError, ProblemError, WaitTimeoutError
from pincette.client.errors import RAISED
from pincette_supervisor.kinds.grip import GripJobRequest

from . import desk
from .desk import Desk

REFUSED = httpx.ConnectError("refused")
LOST = httpx.ReadTimeout("lost")


def test_each_start_sends_one_request_with_its_own_key() -> None:
    supervisor = Desk(desk.job(), desk.job())
    rig = supervisor.supervisor().rig("demo")
    rig.start("grip", force_mN=15.0, labels={"part": "b"})
    rig.start(GripJobRequest(kind="grip", hold_s=2.0), autostart=False)
    first, second = supervisor.asked
    body = {"kind": "grip", "rig": "demo", "force_mN": 15.0, "labels": {"part": "b"}}
    assert json.loads(first.content) == {**body, "autostart": True}
    assert json.loads(second.content) == {
        "kind": "grip",
        "rig": "demo",
        "hold_s": 2.0,
        "autostart": False,
    }
    assert first.headers["Idempotency-Key"] != second.headers["Idempotency-Key"]
    assert len(first.headers["Idempotency-Key"]) == 32


def test_a_start_with_a_lost_reply_is_repeated_with_the_same_key() -> None:
    supervisor = Desk(LOST, REFUSED, desk.job(state="running"))
    job = supervisor.supervisor().rig("demo").start("grip")
    assert job.state == "running"
    assert supervisor.paths() == ["POST /api/v1/jobs"] * 3
    assert len({request.headers["Idempotency-Key"] for request in supervisor.asked}) == 1
    assert supervisor.slept_s == [0.1, 0.2]


def test_a_key_can_be_passed_to_the_client() -> None:
    supervisor = Desk(desk.job())
    supervisor.supervisor().rig("demo").start("grip", idempotency_key="cell-7-part-12")
    assert supervisor.asked[0].headers["Idempotency-Key"] == "cell-7-part-12"


@pytest.mark.parametrize("action", ["start", "pause", "stop", "abort"])
def test_idempotent_stops_are_repeated(action: str) -> None:
    supervisor = Desk(desk.job(), LOST, desk.job())
    job = supervisor.supervisor().job("j")
    getattr(job, action)()
    assert json.loads(supervisor.asked[-1].content) == {"type": action}
    assert len(supervisor.asked) == 3


@pytest.mark.parametrize("action", ["resume", "release", "proceed"])
def test_requests_that_could_act_twice_are_not_repeated(action: str) -> None:
    supervisor = Desk(desk.job(), REFUSED, LOST)
    job = supervisor.supervisor().job("j")
    with pytest.raises(NoAnswerError, match="may or may not have been accepted"):
        getattr(job, action)()
    # A refused connection has carried nothing; a lost one may have.
    assert supervisor.slept_s == [0.1]
    assert len(supervisor.asked) == 3


def test_a_decision_is_sent_with_its_place_and_is_not_retried() -> None:
    place = {"x_um": 6.2, "u_um": 0.5, "measured_at": "2026-03-01T12:00:00Z", "source": "camera-1"}
    supervisor = Desk(desk.job(), LOST)
    with pytest.raises(NoAnswerError):
        supervisor.supervisor().job("j").act("retry_at", place=place)
    assert json.loads(supervisor.asked[-1].content) == {"type": "retry_at", "place": place}
    assert len(supervisor.asked) == 2


def test_retries_end_when_the_time_limit_of_the_client_is_reached() -> None:
    supervisor = Desk(*[REFUSED] * 50)
    with pytest.raises(NoAnswerError, match=r"GET http://supervisor/api/v1/rigs: no answer"):
        supervisor.supervisor(patience_s=5.0).rigs()
    assert supervisor.slept_s == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6, 1.9])
    with pytest.raises(NoAnswerError):
        supervisor.supervisor(patience_s=0.0).rigs()
    assert len(supervisor.slept_s) == 6


def test_an_invalid_address_is_reported_at_once() -> None:
    supervisor = Desk(httpx.UnsupportedProtocol("no http://"))
    with pytest.raises(NoAnswerError, match="no http://"):
        supervisor.supervisor().rigs()


def test_a_refusal_has_its_members_and_is_never_repeated() -> None:
    violation = {"pointer": "/force_mN", "message": "force 55 mN above the limit 40 mN"}
    supervisor = Desk(
        desk.problem(422, "limit-violation", violations=[violation]),
        desk.problem(409, "invalid-transition", allowed_actions=["abort"]),
        desk.problem(503, "rig-not-ready", reasons=["sensor: silent"]),
    )
    rig = supervisor.supervisor().rig("demo")
    with pytest.raises(ProblemError) as first:
        rig.start("grip", force_mN=55.0)
    assert (first.value.status, first.value.code) == (422, "limit-violation")
    assert first.value.violations == [violation]
    assert str(first.value) == "Title:\n  force 55 mN above the limit 40 mN"
    with pytest.raises(ProblemError) as second:
        rig.start("grip")
    assert second.value.allowed_actions == ["abort"]
    assert str(second.value) == "Title: detail"
    with pytest.raises(ProblemError) as third:
        rig.start("grip")
    assert third.value.reasons == ["sensor: silent"]
    assert supervisor.slept_s == []


def test_a_reply_from_another_server_is_reported() -> None:
    gateway = httpx.Response(502, text="bad gateway")
    supervisor = Desk(httpx.Response(200, text="<html>"), gateway)
    with pytest.raises(ForeignAnswerError, match="does not come from a supervisor"):
        supervisor.supervisor().rigs()
    with pytest.raises(NoAnswerError, match="status 502, without a problem document"):
        supervisor.supervisor(patience_s=0.0).rigs()


@pytest.mark.parametrize("status", [502, 503, 504])
def test_an_error_of_a_proxy_that_cannot_reach_the_supervisor_is_retried(status: int) -> None:
    supervisor = Desk(httpx.Response(status, text="<html>"), desk.job(state="running"))
    assert supervisor.supervisor().rig("demo").start("grip").state == "running"
    assert len({request.headers["Idempotency-Key"] for request in supervisor.asked}) == 1


def test_a_delivered_start_is_never_reported_as_undelivered() -> None:
    supervisor = Desk(LOST, *[REFUSED] * 50)
    with pytest.raises(NoAnswerError) as lost:
        supervisor.supervisor(patience_s=5.0).rig("demo").start("grip", idempotency_key="k7")
    assert lost.value.delivered
    assert "may or may not have been accepted: `pincette job list` shows it" in str(lost.value)
    assert "Idempotency-Key k7 it creates no second job" in str(lost.value)
    with pytest.raises(NoAnswerError) as unsent:
        Desk(*[REFUSED] * 50).supervisor(patience_s=5.0).rig("demo").start("grip")
    assert not unsent.value.delivered
    assert "no answer (refused)" in str(unsent.value)


def test_unknown_newer_members_are_ignored() -> None:
    supervisor = Desk(desk.job(novelty={"of": "another version"}), desk.rig(novelty=1))
    assert supervisor.supervisor().job("j").job.kind == "grip"
    assert supervisor.supervisor().rig("demo").state().name == "demo"


def test_a_plan_is_requested_without_a_job() -> None:
    supervisor = Desk(httpx.Response(200, json=desk.example(Plan)))
    plan = supervisor.supervisor().rig("demo").plan("grip", force_mN=10.0)
    assert isinstance(plan, Plan)
    assert supervisor.asked[0].url.params["dry_run"] == "true"
    assert "Idempotency-Key" not in supervisor.asked[0].headers


def test_bring_up_shows_the_warnings_for_the_path_in_the_rig_file() -> None:
    warned = {**desk.example(Plan), "warnings": ["fit an RC of 3.3 ms"]}
    supervisor = Desk(httpx.Response(200, json=warned))
    assert path_warnings(supervisor.supervisor().rig("demo")) == ["fit an RC of 3.3 ms"]
    assert json.loads(supervisor.asked[0].content)["kind"] == "track"


def test_the_reasons_why_a_rig_cannot_start_are_returned() -> None:
    supervisor = Desk(desk.rig(), desk.rig(can_start=False, reasons=["latched: estop"]))
    rig = supervisor.supervisor().rig("demo")
    assert rig.can_start() == []
    assert rig.can_start() == ["latched: estop"]


def test_waiting_survives_a_restart_and_ends_in_time() -> None:
    ended = desk.job(state="succeeded")
    supervisor = Desk(desk.job(), desk.job(), LOST, REFUSED, REFUSED, ended)
    job = supervisor.supervisor().job("j")
    assert job.wait().state == "succeeded"
    assert [request.url.params.get("wait") for request in supervisor.asked[1:]] == ["terminal"] * 5
    assert job.wait().state == "succeeded"

    def late(_request: httpx.Request) -> httpx.Response:
        slow.now_s += 3.0
        return desk.job()

    slow = Desk(late, late, late)
    with pytest.raises(WaitTimeoutError, match="is running after 4 s, and continues"):
        slow.supervisor().job("j").wait(4.0)
    assert [request.url.params.get("timeout_s") for request in slow.asked] == [None, "4.0", "1.0"]


def test_a_single_rig_needs_no_name() -> None:
    one, two = desk.example(desk.Rig), desk.example(desk.Rig, name="left")
    supervisor = Desk(
        httpx.Response(200, json={"rigs": [one]}), httpx.Response(200, json={"rigs": [one, two]})
    )
    assert supervisor.supervisor().rig().name == "demo"
    with pytest.raises(Exception, match="serves 2: demo, left"):
        supervisor.supervisor().rig()


def test_the_asynchronous_client_sends_the_same_requests() -> None:
    supervisor = Desk(LOST, desk.job(), desk.job(state="succeeded"))

    async def run() -> str:
        async with supervisor.async_supervisor() as connected:
            rig = await connected.rig("demo")
            job = await rig.start("grip", force_mN=15.0)
            await job.wait()
            return job.state

    assert asyncio.run(run()) == "succeeded"
    assert supervisor.paths()[:2] == ["POST /api/v1/jobs"] * 2
    assert len({request.headers["Idempotency-Key"] for request in supervisor.asked[:2]}) == 1


def test_each_refusal_code_raises_its_own_exception_type() -> None:
    assert RAISED.keys() <= REMEDIES.keys()
    for code, raised in RAISED.items():
        supervisor = Desk(desk.problem(409, code))
        with pytest.raises(ProblemError) as caught:
            supervisor.supervisor().rig("demo").start("grip")
        assert type(caught.value) is raised
        assert caught.value.code == code
    with pytest.raises(ProblemError) as caught:
        Desk(desk.problem(409, "record-kept")).supervisor().rig("demo").start("grip")
    assert type(caught.value) is ProblemError


def test_a_job_is_stopped_by_the_key_of_its_start_request() -> None:
    stopped = {**desk.example(Job, state="stopping")}
    supervisor = Desk(
        httpx.Response(200, json={"job": None}), LOST, httpx.Response(200, json={"job": stopped})
    )
    rig = supervisor.supervisor().rig("demo")
    assert rig.stop("execution 7") is None
    job = rig.stop("execution 7")
    assert job is not None
    assert job.state == "stopping"
    assert supervisor.paths() == ["POST /api/v1/jobs/stop"] * 3
    assert json.loads(supervisor.asked[0].content) == {"idempotency_key": "execution 7"}
