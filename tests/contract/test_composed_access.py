"""A program that composes services, over real TLS: it publishes for them only."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

from collections.abc import Callable, Generator
from contextlib import ExitStack
from dataclasses import dataclass, field
from time import monotonic, sleep

import pytest

from pincette.bus.endpoints import program_endpoint, router_endpoint, service_endpoint
from pincette.bus.protocol import BusError
from pincette.bus.session import open_session
from pincette.bus.zenoh_bus import ZenohBus
from pincette.cli.estop import EmergencyStop
from pincette.config import RigFile
from pincette.core.codec import encode
from pincette.core.faults import Cause
from pincette.core.messages import Ack, Arm, Command, Message, Trip
from pincette.core.messages.arms import ArmCommand
from pincette.core.topics import ARM, COMMAND, LOOP, TOPICS, TRIP, key, live_key
from pincette.engine.process import loop_programs
from pincette.security.establishing import enrol
from pincette.security.folder import Folder
from pincette.security.identity import SecurityError, program
from tests.bench.shape import EXAMPLES
from tests.support.certificates import NOW, Intruder, folder_for
from tests.support.partitions import composing
from tests.support.rigs import demo_rig

WAIT_S = 30.0
QUIET_S = 0.3
"""Time within which a permitted put has certainly arrived, in s."""
PAIR = "estimator+controller"
OWN = {"estimate", "command", "telemetry", "request_log"}
TRUE = Command(
    2**40, 8, 3, (ArmCommand(1.5),), part_held=False, zero=False, final=False, valid=True
)


@dataclass
class Site:
    """A program of two services, an actuator, a supervisor, and the messages that they received."""

    rig: RigFile
    folder: Folder
    pair: ZenohBus
    actuator: ZenohBus
    supervisor: ZenohBus
    commands: list[Message] = field(default_factory=list[Message])
    told: set[str] = field(default_factory=set[str])
    """Topics that the supervisor has received."""
    asked: list[Message] = field(default_factory=list[Message])

    def answer(
        self, _question: object, request: Message, reply: Callable[[Message | str], None]
    ) -> None:
        self.asked.append(request)
        reply(Ack(1))

    def begin(self) -> None:
        self.actuator.subscribe(COMMAND, lambda _topic, message: self.commands.append(message))
        for topic in TOPICS:
            self.supervisor.subscribe(topic, lambda topic, _message: self.told.add(topic.name))
        self.actuator.serve(TRIP, self.answer)
        for service in ("controller", "sensor"):
            self.pair.serve(ARM[service], self.answer)
        for service in ("estimator", "controller", "sensor"):
            self.pair.announce(service)
        self.actuator.announce("actuator")
        self.until(lambda: self.supervisor.alive() >= {"estimator", "controller", "actuator"})
        self.until(lambda: "actuator" in self.pair.alive())

    def until(self, there: Callable[[], bool]) -> None:
        deadline = monotonic() + WAIT_S
        while not there():
            assert monotonic() < deadline, (self.commands, self.told)
            sleep(0.01)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Generator[Site]:
    folder = folder_for(tmp_path_factory.mktemp("certificates") / "pki", "demo")
    enrol(folder, "demo", (), NOW, composed=[PAIR])
    rig = composing(demo_rig(), PAIR).secured(folder.path)
    programs = loop_programs(rig)
    with ExitStack() as stack:
        stack.enter_context(open_session(router_endpoint(rig), "router"))
        pair, actuator = (
            ZenohBus(service_endpoint(rig, name, programs), "demo", name)
            for name in (PAIR, "actuator")
        )
        place = program_endpoint(rig, "supervisor", lockstep=False)
        made = Site(rig, folder, pair, actuator, ZenohBus(place, "demo", "supervisor"))
        for bus in (pair, actuator, made.supervisor):
            stack.callback(bus.close)
        made.begin()
        yield made


def test_a_composed_program_publishes_the_keys_of_its_services_only(site: Site) -> None:
    for topic in TOPICS:
        for service in LOOP if topic.per_service else ("",):
            site.pair.declare(topic, service)
    names = {type(example): example for example in (*EXAMPLES.values(), TRUE)}
    before = len(site.commands)
    for message in names.values():
        site.pair.publish(message)
    site.until(lambda: len(site.commands) > before and "estimate" in site.told)
    sleep(QUIET_S)
    stated = {topic.name for topic in TOPICS if topic.message in names}
    assert {"position", "applied"} <= stated, (
        "the program should have tried to publish on topics of other programs"
    )
    assert site.told == stated & OWN


def test_a_composed_program_answers_for_its_services_only(site: Site) -> None:
    request = Arm(1, 1, "")
    assert site.supervisor.call(ARM["controller"], request) == Ack(1)
    with pytest.raises(BusError, match="no program answers sensor/arm"):
        site.supervisor.call(ARM["sensor"], request, 0.3)
    site.until(lambda: site.supervisor.alive() == {"estimator", "controller", "actuator"})
    with pytest.raises(BusError, match="may demo/estimator\\+controller send it"):
        site.pair.call(TRIP, Trip(Cause.ESTOP), 0.3)


@pytest.mark.parametrize("who", ["controller", "estimator"])
def test_a_certificate_of_one_of_its_services_cannot_publish_commands(site: Site, who: str) -> None:
    """If the rig file composes a service, the separate service is not accepted as a partner."""
    intruder = Intruder(who, site.folder.credentials(program(who, "demo")))
    before = len(site.commands)
    with intruder.joined("127.0.0.1", site.rig.bus.port + 4) as session:
        session.put(key("demo", COMMAND), encode(TRUE))
        session.liveliness().declare_token(live_key("demo", "sensor"))
        sleep(QUIET_S)
    assert len(site.commands) == before


def test_a_composed_program_does_not_start_without_its_certificate(site: Site) -> None:
    rig = composing(site.rig, "loop")
    with pytest.raises(SecurityError, match=r"loop\.crt: No such file"):
        service_endpoint(rig, "loop", loop_programs(rig))


def test_an_emergency_stop_reaches_an_actuator_directly_if_the_other_services_are_composed(
    site: Site,
) -> None:
    assert EmergencyStop("demo").past_supervisor(site.rig).missing() == []
    assert site.asked[-1] == Trip(Cause.ESTOP)


def test_an_emergency_stop_reaches_a_program_that_contains_all_services_directly(
    site: Site,
) -> None:
    enrol(site.folder, "demo", (), NOW, composed=["loop"])
    rig = composing(demo_rig(), "loop").secured(site.folder.path)
    whole = ZenohBus(service_endpoint(rig, "loop", loop_programs(rig)), "demo", "loop")
    whole.serve(TRIP, site.answer)
    site.asked.clear()
    assert EmergencyStop("demo").past_supervisor(rig).missing() == []
    assert set(site.asked) == {Trip(Cause.ESTOP)}
    whole.close()
