"""Access lists over real TLS: which messages they let pass and which they block.

A router, an actuator and a controller represent the real programs; intruders of every kind connect
to the router's port and to the actuator's own.
"""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import subprocess
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from time import monotonic, sleep

import pytest
import zenoh

from pincette.bus.endpoints import (
    direct_endpoint,
    program_endpoint,
    router_endpoint,
    service_endpoint,
    tool_endpoint,
)
from pincette.bus.protocol import BusError
from pincette.bus.session import open_session
from pincette.bus.stopping import trip_at
from pincette.bus.zenoh_bus import ZenohBus
from pincette.cli.estop import EmergencyStop
from pincette.config import RigFile
from pincette.core.codec import encode
from pincette.core.faults import Cause
from pincette.core.messages import Ack, Arm, Command, Message, Reset, Trip
from pincette.core.messages.arms import ArmCommand
from pincette.core.topics import ARM, COMMAND, RESET, TRIP, Request
from pincette.engine.process import loop_services
from pincette.security.establishing import enrol
from pincette.security.folder import Folder
from pincette.security.identity import program
from tests.bench.shape import EXAMPLES
from tests.support.certificates import NOW, Intruder, ask, folder_for, seen_as, stranger
from tests.support.rigs import demo_rig

WAIT_S = 30.0
QUIET_S = 0.3
"""Time within which a permitted put has certainly arrived, in s."""
FORGED = Command(
    2**40, 7, 3, (ArmCommand(2.5),), part_held=False, zero=False, final=False, valid=True
)
TRUE = Command(
    2**40, 8, 3, (ArmCommand(1.5),), part_held=False, zero=False, final=False, valid=True
)
EXAMPLE = Path(__file__).parents[2] / "docs/examples/secure/subscribe.py"
ESTIMATED = EXAMPLES["estimator"]
PUTS = ("{rig}/command", "{rig}/*", "*/command", "**", "{rig}/**")
REQUESTS: tuple[tuple[Request, Message], ...] = (
    (TRIP, Trip(Cause.ESTOP)),
    (RESET, Reset(acknowledge=True)),
    (ARM["actuator"], Arm(1, 1, "")),
)


@dataclass
class Site:
    """A rig's router, actuator and controller, and what reached the actuator."""

    rig: RigFile
    folder: Folder
    controller: ZenohBus
    got: list[Message] = field(default_factory=list[Message])
    asked: list[Message] = field(default_factory=list[Message])

    def heard(self, count: int) -> None:
        deadline = monotonic() + WAIT_S
        while len(self.got) < count:
            assert monotonic() < deadline, self.got
            sleep(0.005)

    def ports(self) -> tuple[int, int]:
        """Port of the router, and the actuator's own port."""
        return self.rig.bus.port, self.rig.bus.port + 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    made = folder_for(tmp_path_factory.mktemp("certificates") / "pki", "demo")
    enrol(made, "right", (), NOW)
    return made


@pytest.fixture(scope="module")
def site(folder: Folder) -> Generator[Site]:
    rig, services = demo_rig().secured(folder.path), loop_services()
    with ExitStack() as stack:
        stack.enter_context(open_session(router_endpoint(rig), "router"))
        controller, actuator = (
            ZenohBus(service_endpoint(rig, name, services), "demo", name)
            for name in ("controller", "actuator")
        )
        for bus in (controller, actuator):
            stack.callback(bus.close)
        made = Site(rig, folder, controller)

        def answer(_: Request, request: Message, reply: Callable[[Message | str], None]) -> None:
            made.asked.append(request)
            reply(Ack(1))

        actuator.subscribe(COMMAND, lambda _topic, message: made.got.append(message))
        for question, _ in REQUESTS:
            actuator.serve(question, answer)
        for name, bus in (("actuator", actuator), ("controller", controller)):
            bus.announce(name)
        controller.declare(COMMAND)
        deadline = monotonic() + WAIT_S
        while "actuator" not in controller.alive():
            assert monotonic() < deadline
            sleep(0.01)
        yield made


def test_a_command_of_the_controller_arrives_once_over_the_direct_link(site: Site) -> None:
    before = len(site.got)
    site.controller.publish(TRUE)
    site.heard(before + 1)
    sleep(QUIET_S)
    assert site.got[before:] == [TRUE], (
        "the command must arrive once, although the router could forward it too"
    )


@pytest.mark.parametrize(
    "who", ["viewer", "operator", "demo/sensor", "right/controller", "supervisor"]
)
def test_other_admitted_clients_can_send_no_commands(site: Site, who: str) -> None:
    intruder = Intruder(who, site.folder.credentials(site.folder.named(who)))
    before = len(site.got)
    for port, mode in product(site.ports(), ("client", "peer", "router")):
        with Intruder(who, intruder.credentials, mode=mode).joined("127.0.0.1", port) as session:
            for place in PUTS:
                wanted = f"pincette/v2/{place.format(rig='demo')}"
                session.put(wanted, encode(FORGED))
                session.delete(wanted)
            sleep(QUIET_S)
    site.controller.publish(TRUE)
    site.heard(before + 1)
    assert site.got[before:] == [TRUE]


@pytest.mark.parametrize("who", ["viewer", "demo/sensor", "right/controller", "right/actuator"])
def test_clients_without_permission_get_no_answer(site: Site, who: str) -> None:
    intruder = Intruder(who, site.folder.credentials(site.folder.named(who)))
    for port in site.ports():
        with intruder.joined("127.0.0.1", port) as session:
            for question, request in REQUESTS:
                assert ask(session, "demo", question, request) == []
    assert site.asked == []


def test_an_operator_can_request_a_trip_on_both_paths_but_nothing_else(site: Site) -> None:
    for ends in (direct_endpoint(site.rig, "actuator"), tool_endpoint(site.rig)):
        bus = ZenohBus(ends, "demo", "tool")
        assert bus.call(TRIP, Trip(Cause.ESTOP)) == Ack(1)
        with pytest.raises(BusError, match="may operator send it"):
            bus.call(RESET, Reset(acknowledge=True), 0.3)
        bus.close()
    assert site.asked == [Trip(Cause.ESTOP), Trip(Cause.ESTOP)]
    site.asked.clear()


def test_an_emergency_stop_without_the_supervisor_needs_the_certificate_of_an_operator(
    site: Site,
) -> None:
    refused = EmergencyStop("demo").past_supervisor(seen_as(site.rig, "viewer"))
    assert (refused.attempts.confirmed, refused.missing()) == ({}, ["demo"])
    assert all("may viewer send it" in str(error) for _, error in refused.attempts.failed)
    nobody = EmergencyStop("demo").past_supervisor(seen_as(site.rig, "nobody"))
    assert "'nobody' has no certificate" in str(nobody.attempts.failed[0][1])
    assert site.asked == []
    stopped = EmergencyStop("demo").past_supervisor(site.rig)
    assert stopped.missing() == []
    assert set(site.asked) == {Trip(Cause.ESTOP)}
    site.asked.clear()


def test_the_supervisor_can_trip_without_the_router_but_make_no_other_request(site: Site) -> None:
    ends = direct_endpoint(site.rig, "actuator", program("supervisor", ""))
    assert trip_at(ends, "demo", Trip(Cause.ESTOP)) == Ack(1)
    assert site.asked == [Trip(Cause.ESTOP)]
    bus = ZenohBus(ends, "demo", "supervisor")
    with pytest.raises(BusError):
        bus.call(RESET, Reset(), 0.3)
    bus.close()
    assert site.asked == [Trip(Cause.ESTOP)]
    site.asked.clear()
    site.asked.clear()


def test_the_supervisor_can_send_requests_to_all_programs(site: Site) -> None:
    bus = ZenohBus(program_endpoint(site.rig, "supervisor", lockstep=False), "demo", "supervisor")
    for question, request in REQUESTS:
        assert bus.call(question, request) == Ack(1)
    bus.close()
    assert site.asked == [request for _, request in REQUESTS]
    site.asked.clear()


def test_a_rig_that_joins_a_router_publishes_its_own_keys_only(site: Site) -> None:
    joins = {"rig": {"name": "right"}, "bus": {"router": f"127.0.0.1:{site.rig.bus.port}"}}
    right = demo_rig(joins).secured(site.folder.path)
    services, heard = loop_services(), list[Message]()
    controller = ZenohBus(service_endpoint(right, "controller", services), "right", "controller")
    everywhere = ZenohBus(
        program_endpoint(site.rig, "supervisor", lockstep=False), "right", "hears"
    )
    everywhere.subscribe(COMMAND, lambda _topic, message: heard.append(message))
    controller.announce("controller")
    deadline = monotonic() + WAIT_S
    while not heard:
        assert monotonic() < deadline
        controller.publish(TRUE)
        sleep(0.05)
    assert heard[0] == TRUE
    while not everywhere.alive_everywhere() >= {("right", "controller"), ("demo", "controller")}:
        assert monotonic() < deadline
    # the router also announces the client's own token to it
    while controller.alive() != {"controller"}:
        assert monotonic() < deadline
    for bus in (controller, everywhere):
        bus.close()


def test_a_viewer_subscribes_and_queries_the_newest_messages(site: Site) -> None:
    bus = ZenohBus(tool_endpoint(seen_as(site.rig, "viewer")), "demo", "tool")
    heard: list[Message] = []
    bus.subscribe(COMMAND, lambda _topic, message: heard.append(message))
    deadline = monotonic() + WAIT_S
    while not heard:
        assert monotonic() < deadline
        site.controller.publish(TRUE)
        sleep(0.05)
    assert heard[0] == TRUE
    assert bus.latest(COMMAND) == TRUE
    while bus.alive() != {"actuator", "controller"}:
        assert monotonic() < deadline
    bus.close()


def test_a_script_without_pincette_can_subscribe(site: Site) -> None:
    place = f"tls/127.0.0.1:{site.rig.bus.port}"
    words = [sys.executable, str(EXAMPLE), "--pki", str(site.folder.path), "--router", place]
    estimator = ZenohBus(
        service_endpoint(site.rig, "estimator", loop_services()), "demo", "estimator"
    )
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    end = threading.Event()

    def play() -> None:
        while not end.wait(QUIET_S):
            estimator.publish(ESTIMATED)

    player = threading.Thread(target=play)
    player.start()
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "  31.400 µm    9.870 mN\n"
    finally:
        end.set()
        player.join()
        process.kill()
        process.communicate()
        estimator.close()


def test_another_rig_receives_nothing_of_this_rig(site: Site) -> None:
    recorder = Intruder("recorder", site.folder.credentials(program("recorder", "right")))
    heard: list[str] = []
    with recorder.joined("127.0.0.1", site.rig.bus.port) as session:
        for wanted in ("pincette/v2/demo/*", "pincette/v2/*/*", "**"):
            session.declare_subscriber(wanted, lambda sample: heard.append(str(sample.key_expr)))
        sleep(QUIET_S)
        site.controller.publish(TRUE)
        sleep(QUIET_S)
    assert heard == []


def test_clients_without_a_valid_certificate_are_not_admitted(site: Site, tmp_path: Path) -> None:
    outsiders = [
        Intruder("plain", None, "tcp"),
        Intruder("bare", None, "tls"),
        stranger(tmp_path / "rogue", "demo", program("controller", "demo")),
    ]
    for outsider, port in product(outsiders, site.ports()):
        with pytest.raises(zenoh.ZError), outsider.joined("127.0.0.1", port):
            pass
