"""A router that stops forwarding while a part is held is replaced, and the part stays held."""

import os
import signal
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.bus.topology import direct_session
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config.reading import laid_over
from pincette.core.messages import Applied, Message, Telemetry
from pincette.core.topics import APPLIED, TELEMETRY, Topic
from pincette.engine.revival import Revival
from pincette.engine.router_watch import CODE, ENDED_STATUS
from tests.support.grips import SHORT, TRIPPED, make_ready
from tests.support.rigs import Tree, demo_rig
from tests.support.running import RunningRig, running_rig

pytestmark = pytest.mark.usefixtures("stalls")

HERE = Path(__file__).parents[1] / "support" / "locked_router"
MOST_S = 60.0
"""Longest time for a step on a busy machine."""
LOOK_S = 0.1
LEASE_S = 1.2
STOP_S = 2.5
LATE: Tree = {"safety": {"command_age_periods": 10.0}}
"""Allowed lateness of a command, large since a busy machine is not what is tested."""


class PastTheRouter:
    """Messages of actuator and controller, over links that do not use the router."""

    def __init__(self) -> None:
        self.echoes: list[tuple[float, Applied]] = []
        self.views: list[tuple[float, Telemetry]] = []

    def take(self, _topic: Topic, message: Message) -> None:
        now_s = monotonic()
        if isinstance(message, Applied):
            self.echoes.append((now_s, message))
        elif isinstance(message, Telemetry):
            self.views.append((now_s, message))

    def assert_held_since(self, since_s: float) -> None:
        views = [view for at, view in self.views if at > since_s]
        echoes = [echo for at, echo in self.echoes if at > since_s]
        assert views
        assert echoes
        assert {(view.phase, view.held) for view in views} == {("hold", True)}
        assert not [echo for echo in echoes if echo.state in (*TRIPPED, "latched")]


@contextmanager
def past_the_router(rig: RunningRig) -> Generator[PastTheRouter]:
    heard, host, port = PastTheRouter(), rig.rig.bus.host, rig.rig.bus.port
    with ExitStack() as stack:
        for program, topic in (("actuator", APPLIED), ("controller", TELEMETRY)):
            bus = ZenohBus(direct_session(host, port, program), rig.rig.rig.name, "direct")
            stack.callback(bus.close)
            bus.subscribe(topic, heard.take)
        yield heard


@pytest.fixture
def lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file whose existence blocks the router's reply to itself."""
    place = tmp_path / "locked"
    monkeypatch.setenv("PINCETTE_TEST_LOCKED", str(place))
    before = os.environ.get("PYTHONPATH")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(HERE), before))))
    return place


@pytest.fixture
def rig(lock: Path, tmp_path: Path, request: pytest.FixtureRequest) -> Generator[RunningRig]:
    assert not lock.exists()
    changes = getattr(request, "param", {})
    own = demo_rig(laid_over(laid_over(SHORT, LATE), changes))
    with running_rig(own, tmp_path) as running:
        yield running


def held(rig: RunningRig) -> str:
    """Grip until released, and return the job once it holds the part."""
    make_ready(rig, MOST_S)
    job = rig.start_grip(until_released=True)
    rig.until_phase(job, "hold", MOST_S)
    sleep(10 * LOOK_S)
    return job


def test_a_locked_router_ends_and_is_replaced_while_a_part_is_held(
    rig: RunningRig, lock: Path, figures: list[str]
) -> None:
    job, revival = held(rig), Revival(rig.fleet)
    locked = rig.fleet.members["router"].process
    with past_the_router(rig) as heard:
        begun_s = monotonic()
        lock.touch()
        while locked.poll() is None:
            assert monotonic() < begun_s + MOST_S
            sleep(LOOK_S)
        ended_s = monotonic() - begun_s
        lock.unlink()
        assert locked.returncode == ENDED_STATUS
        assert CODE in rig.fleet.members["router"].log.read_text(encoding="utf-8")
        while any(one["trouble"] for one in rig.view()["programs"]) or not replaced(rig):
            assert monotonic() < begun_s + MOST_S, rig.view()["programs"]
            revival.look(lambda _member, _line: None)
            sleep(LOOK_S)
        back_s = monotonic() - begun_s
        sleep(LOOK_S)
        heard.assert_held_since(begun_s)
    state = rig.job(job)["state"]
    figures.append(
        f"locked router: ended after {ended_s:.1f} s, all are seen again after {back_s:.1f} s, "
        f"the job reads {state}"
    )
    if state == "running":
        rig.post(f"/jobs/{job}/actions", {"type": "release"}).raise_for_status()
    else:
        assert back_s > rig.rig.safety.lease_s
        release = rig.post("/jobs", {"kind": "release", "autostart": True}).raise_for_status()
        job = release.json()["id"]
    assert rig.ended(job)["state"] == "succeeded"


def replaced(rig: RunningRig) -> bool:
    """Return whether a router serves."""
    member = rig.fleet.members["router"]
    return member.process.poll() is None and member.ready.is_set()


@pytest.mark.parametrize("rig", [{"safety": {"lease_s": LEASE_S}}], indirect=True)
def test_a_hanging_router_drops_no_part_and_prevents_no_stop(rig: RunningRig) -> None:
    held(rig)
    with past_the_router(rig) as heard:
        begun_s = monotonic()
        rig.fleet.signal("router", signal.SIGSTOP)
        try:
            sleep(3.0 * LEASE_S)
            heard.assert_held_since(begun_s)
            stopped_s = monotonic()
            answer = rig.post("/rigs/demo/estop")
            assert answer.status_code == 200, answer.text
            assert monotonic() - stopped_s < STOP_S
            while heard.echoes[-1][1].state not in (*TRIPPED, "latched"):
                assert monotonic() < stopped_s + MOST_S, heard.echoes[-1]
                sleep(LOOK_S)
        finally:
            rig.fleet.signal("router", signal.SIGCONT)
    while any(one["trouble"] for one in rig.view()["programs"]):
        assert monotonic() < stopped_s + MOST_S, rig.view()["programs"]
        sleep(LOOK_S)
    # A router that was not scheduled for a time is not treated as locked.
    assert rig.fleet.members["router"].process.poll() is None
