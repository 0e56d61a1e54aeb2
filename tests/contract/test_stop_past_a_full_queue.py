"""The router hangs and the queue to it is full: a stop still uses the direct link in time."""

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import ExitStack
from time import monotonic

import pytest

from pincette.bus.endpoints import direct_endpoint, program_endpoint, service_endpoint
from pincette.bus.protocol import BusError
from pincette.bus.stopping import trip_at
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.core.faults import Cause
from pincette.core.messages import Ack, JobNotice, Message, Trip
from pincette.core.topics import JOB, TRIP, Request
from pincette.engine.process import loop_services
from pincette_supervisor.rigs.rig_context import TRIP_S, ActuatorTrip
from tests.support.foreign import declared, outsider
from tests.support.rigs import demo_rig
from tests.support.routed import until

ROUTER = """
import sys
from pincette.bus.session import serve_router
from pincette.bus.topology import router_session
serve_router(router_session("127.0.0.1", int(sys.argv[1])), "demo", lambda _ask: sys.stdin.read())
"""
NOTICE = JobNotice("j" * 300, "grip", 1, "running", "hold", "c" * 300, held=True, at="t" * 300)
WAITED_S = 30.0
SLACK_S = 1.0


@pytest.fixture
def router() -> Generator[tuple[RigFile, "subprocess.Popen[bytes]"]]:
    rig = demo_rig()
    words = [sys.executable, "-c", ROUTER, str(rig.bus.port)]
    with subprocess.Popen(words, stdin=subprocess.PIPE) as process:
        yield rig, process
        process.send_signal(signal.SIGCONT)
        process.kill()


@pytest.mark.parametrize("beside", ["nothing", "a silent complete store"])
def test_a_direct_stop_is_confirmed_in_time_despite_a_full_queue(
    router: tuple[RigFile, "subprocess.Popen[bytes]"], beside: str
) -> None:
    rig, process = router
    requests: list[Message] = []

    def answer(_: Request, request: Message, reply: Callable[[Message | str], None]) -> None:
        requests.append(request)
        reply(Ack(1))

    with ExitStack() as stack:
        actuator = ZenohBus(service_endpoint(rig, "actuator", loop_services()), "demo", "actuator")
        stack.callback(actuator.close)
        actuator.serve(TRIP, answer)
        actuator.announce("actuator")
        supervisor = _supervisor(rig)
        stack.callback(supervisor.close)
        until(lambda: "actuator" in supervisor.alive(), WAITED_S)
        actuator.subscribe(JOB, lambda _topic, _message: None)
        if beside != "nothing":
            tool = stack.enter_context(outsider("client", f"tcp/{rig.bus.host}:{rig.bus.port}"))
            stack.enter_context(declared(tool, "silent"))
        process.send_signal(signal.SIGSTOP)
        end = threading.Event()
        filling = threading.Thread(target=_fill, args=(supervisor, end))
        filling.start()
        trip = ActuatorTrip(
            "demo", supervisor, lambda trip: trip_at(direct_endpoint(rig, "actuator"), "demo", trip)
        )
        try:
            for _ in range(3):
                begun_s = monotonic()
                assert trip(Trip(Cause.ESTOP)) == Ack(1)
                assert monotonic() - begun_s < TRIP_S + SLACK_S
        finally:
            end.set()
            process.send_signal(signal.SIGCONT)
            filling.join()
    assert Trip(Cause.ESTOP) in requests


def _supervisor(rig: RigFile) -> ZenohBus:
    """Connect as the supervisor, once the router listens."""
    deadline_s = monotonic() + WAITED_S
    while True:
        try:
            return ZenohBus(program_endpoint(rig, "supervisor", lockstep=False), "demo", "sup")
        except BusError:
            assert monotonic() < deadline_s


def _fill(bus: ZenohBus, end: threading.Event) -> None:
    """Publish reliably, which waits for the stalled link again and again."""
    while not end.is_set():
        bus.publish(NOTICE)
