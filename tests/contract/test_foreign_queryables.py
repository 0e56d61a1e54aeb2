"""Requests and queries reach the programs of a rig although foreign stores and tools are
connected."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import threading
from collections.abc import Callable, Generator, Iterable
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from time import monotonic, sleep
from typing import NoReturn, cast

import pytest
import zenoh
from msgspec.structs import replace

from pincette.bus.endpoints import (
    direct_endpoint,
    program_endpoint,
    router_endpoint,
    tool_endpoint,
)
from pincette.bus.endpoints import service_endpoint as loop_endpoint
from pincette.bus.producer import SILENT_S
from pincette.bus.protocol import AbsentError, BusError, RefusalError
from pincette.bus.query import Query
from pincette.bus.session import open_session
from pincette.bus.stopping import trip_at
from pincette.bus.zenoh_bus import EMPTY, ForeignDeclaration, ZenohBus
from pincette.config import RigFile
from pincette.core.codec import encode
from pincette.core.faults import Cause, FaultCode, Mode
from pincette.core.messages import Ack, Applied, Message, Reset, Status, StatusRequest, Trip
from pincette.core.topics import (
    APPLIED,
    RESET,
    STATUS,
    TRIP,
    Request,
    key,
    live_key,
    request_key,
)
from pincette.diagnostics.bus import exchanges, foreign_sessions
from pincette.engine.loop import Loop
from pincette.engine.process import loop_services
from pincette.engine.runner import Runner
from pincette.security.folder import Folder
from pincette.security.identity import program
from tests.bench.shape import EXAMPLES
from tests.support.certificates import Intruder
from tests.support.foreign import EVERYTHING, KINDS, Store, declared, outsider, settle
from tests.support.rigs import demo_rig, free_ports
from tests.support.routed import until

PATIENCE_S = 20.0
ANSWER_S = PATIENCE_S / 8.0
"""Longest time of a call beside a queryable that never replies; a call that waits for it ends after
``PATIENCE_S``, and the session of an unanswered one is opened again after 3 s."""
PLACES = ("client", "peer", "router", "in the router", "at the actuator")
NEWEST = cast(Applied, EXAMPLES["actuator"])
EARLIER = replace(NEWEST, seq=0)
REFUSED = "not while the part is held"
Reply = Callable[[Message | str], None]


@dataclass
class Site:
    """A rig's router, its actuator, and the supervisor that sends it requests."""

    rig: RigFile
    router: zenoh.Session
    actuator: ZenohBus
    supervisor: ZenohBus
    asked: list[Message]
    mode: Mode | None = Mode.IDLE
    """Return the mode that the actuator reports; None if it does not reply."""

    def trip(self) -> Message:
        return self.supervisor.call(TRIP, Trip(Cause.ESTOP), PATIENCE_S)


@contextmanager
def running(rig: RigFile) -> Generator[Site]:
    requests: list[Message] = []
    with ExitStack() as stack:
        router = stack.enter_context(open_session(router_endpoint(rig), "router"))
        actuator = ZenohBus(loop_endpoint(rig, "actuator", loop_services()), "demo", "actuator")
        stack.callback(actuator.close)
        supervisor = ZenohBus(
            program_endpoint(rig, "supervisor", lockstep=False), "demo", "supervisor"
        )
        stack.callback(supervisor.close)

        def take(_: Request, request: Message, reply: Reply) -> None:
            requests.append(request)
            reply(Ack(len(requests)) if isinstance(request, Trip) else REFUSED)

        site = Site(rig, router, actuator, supervisor, requests)

        def state(_: Request, _request: Message, reply: Reply) -> None:
            if site.mode is not None:
                reply(Status("actuator", "", 1, rig.digest(), 0, 0, 0, 0, mode=site.mode))

        for question in (TRIP, RESET):
            actuator.serve(question, take)
        actuator.serve(STATUS["actuator"], state)
        actuator.declare(APPLIED)
        actuator.announce("actuator")
        until(lambda: "actuator" in supervisor.alive())
        yield site


@pytest.fixture(scope="module")
def plain() -> Generator[Site]:
    with running(demo_rig()) as site:
        yield site


@pytest.fixture(scope="module")
def secure(folder: Folder) -> Generator[Site]:
    with running(demo_rig().secured(folder.path)) as site:
        yield site


@contextmanager
def beside(site: Site, kind: str, where: str) -> Generator[Store]:
    """Declare a foreign complete queryable at one of the places where a tool can connect."""
    bus, stamps = site.rig.bus, kind == "stamping store"
    port = bus.port + (4 if where == "at the actuator" else 0)
    mode = {"at the actuator": "peer"}.get(where, where)
    with ExitStack() as stack:
        if where == "in the router":
            session = site.router
        else:
            place = f"tcp/{bus.host}:{port}"
            session = stack.enter_context(outsider(mode, place, stamps=stamps))
        store = stack.enter_context(declared(session, kind))
        probe = stack.enter_context(outsider("client", f"tcp/{bus.host}:{bus.port}"))
        if where != "at the actuator":  # a link between peers only; the router does not see it
            until(lambda: _reaches(probe, store))
        yield store


def _reaches(probe: zenoh.Session, store: Store) -> bool:
    before = store.queries
    with Query(probe, "pincette/probe", 0.1) as query:
        list(query)
    return store.queries > before


@pytest.mark.parametrize(("kind", "where"), [*zip(KINDS, (*PLACES, "client", "peer"), strict=True)])
class TestBesideAForeignQueryable:
    def test_replies_to_stops_and_resets_come_from_the_actuator(
        self, plain: Site, kind: str, where: str
    ) -> None:
        with beside(plain, kind, where):
            plain.asked.clear()
            begun_s = monotonic()
            assert plain.trip() == Ack(1)
            with pytest.raises(RefusalError, match=REFUSED):
                plain.supervisor.call(RESET, Reset(), PATIENCE_S)
            direct = direct_endpoint(plain.rig, "actuator")
            assert trip_at(direct, "demo", Trip(Cause.ESTOP)) == Ack(3)
            assert monotonic() - begun_s < ANSWER_S
            assert plain.asked == [Trip(Cause.ESTOP), Reset(), Trip(Cause.ESTOP)]

    def test_a_query_for_the_newest_message_is_answered_by_its_producer(
        self, plain: Site, kind: str, where: str
    ) -> None:
        plain.actuator.publish(EARLIER)
        with beside(plain, kind, where) as store:
            plain.actuator.publish(EARLIER)
            sleep(0.02)
            for sample in store.newest.values():
                assert sample.payload.to_bytes() == encode(EARLIER)
            remembered = dict(store.newest)
            plain.actuator.publish(NEWEST)
            sleep(0.02)
            store.newest |= remembered  # a store that missed the newer message
            begun_s = monotonic()
            assert plain.supervisor.latest(APPLIED, PATIENCE_S) == NEWEST
            assert monotonic() - begun_s < ANSWER_S


def test_a_program_without_a_message_replies_at_once_despite_a_silent_tool(plain: Site) -> None:
    fresh = ZenohBus(program_endpoint(plain.rig, "recorder", lockstep=False), "fresh", "actuator")
    with beside(plain, "silent", "client"):
        fresh.declare(APPLIED)
        asker = ZenohBus(program_endpoint(plain.rig, "supervisor", lockstep=False), "fresh", "x")
        begun_s = monotonic()
        until(lambda: asker.latest(APPLIED, PATIENCE_S) is None)
        assert monotonic() - begun_s < ANSWER_S
        asker.close()
    fresh.close()


@pytest.mark.parametrize("kind", ["store", "silent"])
def test_an_unanswered_request_ends_at_its_own_deadline(plain: Site, kind: str) -> None:
    bus = ZenohBus(program_endpoint(plain.rig, "supervisor", lockstep=False), "nobody", "asker")
    with beside(plain, kind, "client"):
        begun_s = monotonic()
        with pytest.raises(BusError, match="no program answers actuator/trip"):
            bus.call(TRIP, Trip(Cause.ESTOP), 0.3)
        assert monotonic() - begun_s < 0.3 + ANSWER_S
    bus.close()


def test_an_invalid_reply_with_the_right_attachment_is_counted_and_the_next_reply_is_used(
    plain: Site,
) -> None:
    def rubbish(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, b"\xff", attachment=query.attachment)

    place = f"tcp/{plain.rig.bus.host}:{plain.rig.bus.port}"
    refused = plain.supervisor.refused
    with outsider("client", place) as session:
        served = session.declare_queryable(EVERYTHING, rubbish, complete=True)
        before = refused.count

        def counted() -> bool:
            assert isinstance(plain.trip(), Ack)
            return refused.count > before

        until(counted)
        assert request_key("demo", TRIP) in refused.reason
        served.undeclare()


ODD_TOKENS = (
    "**",
    EVERYTHING,
    "pincette/v2/demo/live/*",
    "pincette/v2/demo/live/**",
    "pincette/v2/*/live/actuator",
    "pincette/v2/demo/live/a$*",
    "pincette/v2/Demo rig/live/sensor",
    "pincette/v2/demo/live/Sensor\N{MICRO SIGN}",
)
"""Liveliness tokens that no program has; a lookup of the programs' tokens finds each of them."""


def test_tokens_without_a_program_are_ignored(plain: Site) -> None:
    place = f"tcp/{plain.rig.bus.host}:{plain.rig.bus.port}"
    changes: list[tuple[str, str, bool]] = []
    with ExitStack() as stack:
        bus = ZenohBus(program_endpoint(plain.rig, "supervisor", lockstep=False), "demo", "x")
        stack.callback(bus.close)
        # A lookup on a busy machine may end before the router has replied.
        before, everywhere = set[str](), set[tuple[str, str]]()
        while "actuator" not in before or ("demo", "actuator") not in everywhere:
            before, everywhere = bus.alive(), bus.alive_everywhere()
        tool, looker = (stack.enter_context(outsider("client", place)) for _ in range(2))
        tokens = [tool.liveliness().declare_token(one) for one in ODD_TOKENS]

        def seen() -> set[str]:
            replies = cast("Iterable[zenoh.Reply]", looker.liveliness().get("**"))
            return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

        until(lambda: seen() >= {*ODD_TOKENS})
        until(lambda: (bus.alive(), bus.alive_everywhere()) == (before, everywhere))
        assert bus.other_wires() == {}
        bus.watch_everywhere(lambda rig, program, alive: changes.append((rig, program, alive)))
        for token in tokens:
            token.undeclare()
        bus.announce("recorder")
        until(lambda: ("demo", "recorder", True) in changes)
    assert {(rig, program) for rig, program, _ in changes} <= everywhere | {("demo", "recorder")}


GHOST_TRIP = request_key("ghost", TRIP)


def test_a_token_without_a_program_is_recognized_at_once(plain: Site) -> None:
    place = f"tcp/{plain.rig.bus.host}:{plain.rig.bus.port}"
    with outsider("client", place) as tool:
        token = tool.liveliness().declare_token(live_key("ghost", "actuator"))
        until(lambda: ("ghost", "actuator") in plain.supervisor.alive_everywhere())
        begun_s = monotonic()
        with pytest.raises(AbsentError):
            plain.supervisor.call(TRIP, Trip(Cause.ESTOP), PATIENCE_S, rig="ghost")
        assert monotonic() - begun_s < ANSWER_S
        token.undeclare()
        until(lambda: ("ghost", "actuator") not in plain.supervisor.alive_everywhere())
        with pytest.raises(BusError) as gone:
            plain.supervisor.call(TRIP, Trip(Cause.ESTOP), PATIENCE_S, rig="ghost")
        assert not isinstance(gone.value, AbsentError)


@pytest.mark.parametrize("kind", ["silent", "drops", "store", "rubbish"])
def test_an_unresponsive_program_is_not_mistaken_for_a_token_without_a_program(
    plain: Site, kind: str
) -> None:
    """A query that a program drops ends at once, like a query that no program receives."""
    place = f"tcp/{plain.rig.bus.host}:{plain.rig.bus.port}"

    def drop(query: zenoh.Query) -> None:
        query.drop()

    with outsider("client", place) as tool, ExitStack() as stack:
        if kind == "drops":
            stack.enter_context(tool.declare_queryable(GHOST_TRIP, drop))
        else:
            stack.enter_context(declared(tool, kind, GHOST_TRIP))
        token = tool.liveliness().declare_token(live_key("ghost", "actuator"))
        until(lambda: ("ghost", "actuator") in plain.supervisor.alive_everywhere())
        with pytest.raises(BusError) as silent:
            plain.supervisor.call(TRIP, Trip(Cause.ESTOP), 0.3, rig="ghost")
        assert not isinstance(silent.value, AbsentError)
        token.undeclare()


def test_with_certificates_a_real_token_is_never_mistaken_for_a_foreign_one(secure: Site) -> None:
    """The access list may refuse the request to a real program; that query ends at once, too."""
    other = ZenohBus(loop_endpoint(secure.rig, "sensor", loop_services()), "demo", "sensor")
    try:
        other.announce("sensor")
        until(lambda: "sensor" in secure.supervisor.alive())
        with pytest.raises(BusError) as refused:
            secure.supervisor.call(STATUS["sensor"], StatusRequest(), ANSWER_S)
        assert not isinstance(refused.value, AbsentError)
    finally:
        other.close()


@pytest.mark.parametrize("who", ["viewer", "demo/sensor"])
def test_a_certificate_without_permission_cannot_declare_a_queryable(
    secure: Site, folder: Folder, who: str
) -> None:
    """The access list refuses both the declaration and the replies of other programs."""
    places = (EVERYTHING, request_key("demo", TRIP), "pincette/v2/demo/call/**", "**")
    heard: list[str] = []

    def reply(query: zenoh.Query) -> None:
        heard.append(str(query.key_expr))
        with query:
            query.reply(query.key_expr, encode(Ack(9)), attachment=query.attachment)

    for mode, port in (("client", 0), ("peer", 0), ("router", 0), ("peer", 4)):
        intruder = Intruder(who, folder.credentials(folder.named(who)), mode=mode)
        with intruder.joined("127.0.0.1", secure.rig.bus.port + port) as session:
            declared_here = [
                session.declare_queryable(place, reply, complete=True) for place in places
            ]
            sleep(0.1)
            secure.asked.clear()
            assert secure.trip() == Ack(1)
            assert declared_here
    assert heard == []


@pytest.mark.parametrize("who", ["operator", "demo/sensor"])
def test_a_certificate_can_hold_only_its_own_token(secure: Site, folder: Folder, who: str) -> None:
    """A token of another program, or one with wildcards, does not pass the router."""
    before, port = secure.supervisor.alive_everywhere(), secure.rig.bus.port
    others = (*ODD_TOKENS, "pincette/v2/demo/live/recorder", "pincette/v2/other/live/actuator")
    intruder = Intruder(who, folder.credentials(folder.named(who)))
    looker = Intruder("operator", folder.credentials(folder.named("operator")))
    with (
        intruder.joined("127.0.0.1", port) as session,
        looker.joined("127.0.0.1", port) as other,
    ):
        tokens = [session.liveliness().declare_token(one) for one in others]
        sleep(0.2)
        replies = cast("Iterable[zenoh.Reply]", other.liveliness().get("pincette/v2/*/live/*"))
        found = {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}
        assert found == {live_key(rig, program) for rig, program in before}
        assert secure.supervisor.alive_everywhere() == before
        assert tokens


@pytest.mark.parametrize("kind", ["stamping store", "silent"])
def test_with_certificates_replies_of_a_store_inside_the_router_are_not_used(
    secure: Site, kind: str
) -> None:
    """No access list applies to a plugin of the router."""
    with declared(secure.router, kind):
        secure.asked.clear()
        assert secure.trip() == Ack(1)
        direct = direct_endpoint(secure.rig, "actuator", program("supervisor", ""))
        assert trip_at(direct, "demo", Trip(Cause.ESTOP)) == Ack(2)
        secure.actuator.publish(NEWEST)
        until(lambda: secure.supervisor.latest(APPLIED, PATIENCE_S) == NEWEST)


def test_replies_of_a_store_in_a_second_router_are_not_used(plain: Site) -> None:
    bus, port = plain.rig.bus, free_ports(1)
    with (
        outsider(
            "router", f"tcp/{bus.host}:{bus.port}", stamps=True, listen=f"tcp/127.0.0.1:{port}"
        ) as second,
        declared(second, "stamping store"),
    ):
        with outsider("client", f"tcp/127.0.0.1:{port}") as client:
            until(lambda: _asked_by(client) == {b"ok"})
        plain.asked.clear()
        assert plain.trip() == Ack(1)


def _asked_by(session: zenoh.Session) -> set[bytes]:
    place = request_key("demo", TRIP)
    with Query(session, place, 1.0, encode(Trip(Cause.ESTOP))) as query:
        return {b"ok" for reply in query if not reply.refused}


def test_an_empty_query_on_a_request_key_is_answered_and_not_counted(plain: Site) -> None:
    place = f"tcp/{plain.rig.bus.host}:{plain.rig.bus.port}"
    before = plain.actuator.refused.count
    with outsider("client", place) as browser:
        for wanted in (request_key("demo", TRIP), "pincette/v2/demo/**", "**"):
            for payload in (None, b""):
                replies = cast("Iterable[zenoh.Reply]", browser.get(wanted, payload=payload))
                errors = [reply.err.payload.to_string() for reply in replies if reply.err]
                assert EMPTY in errors
    assert plain.actuator.refused.count == before


@pytest.mark.parametrize("service", ["estimator", "controller"])
def test_each_program_of_the_loop_counts_and_reports_refused_messages(
    plain: Site, service: str
) -> None:
    """A foreign program sends garbage on a topic that the service subscribes to, and on one of its
    requests."""
    services, rig = loop_services(), "stranger"
    config = program_endpoint(plain.rig, "recorder", lockstep=False)
    bus, asker = ZenohBus(config, rig, service), ZenohBus(config, rig, "asker")
    loop = Loop([Runner(services[service], plain.rig)], bus, refused=bus.refused)
    thread = threading.Thread(target=loop.run)
    thread.start()
    try:
        until(lambda: _status(asker, service) is not None)
        sent = [item.topic for item in services[service].inputs if item.role != "pace"]
        with outsider("client", config.connect[0]) as tool:
            for topic in sent:
                tool.put(key(rig, topic), b"rubbish")
            with Query(tool, request_key(rig, STATUS[service]), 1.0, b"rubbish") as query:
                assert [reply.refused for reply in query] == [True]
        until(lambda: bus.refused.count > len(sent))
        status = _status(asker, service)
        assert status is not None
        assert status.refused == 1 + len(sent)
        assert [one.code for one in status.findings].count(FaultCode.MESSAGES_REFUSED) == 1
    finally:
        loop.stop()
        thread.join()
        bus.close()
        asker.close()


@pytest.mark.parametrize("states", [False, True], ids=["no session", "its own session"])
def test_a_valid_sample_of_another_program_is_refused_until_the_producer_is_silent(
    plain: Site, states: bool
) -> None:
    """The foreign program is ahead: its sequence number is due, and the producer's own sample comes
    later."""
    heard: list[Message] = []
    bus = ZenohBus(tool_endpoint(plain.rig), "demo", "listener")
    bus.subscribe(APPLIED, lambda _topic, message: heard.append(message))
    place, due = key("demo", APPLIED), NEWEST.seq + 1

    def published(message: Applied) -> bool:
        plain.actuator.publish(message)
        return message in heard

    with outsider("client", f"tcp/{plain.rig.bus.host}:{plain.rig.bus.port}") as tool:
        publisher = tool.declare_publisher(place)
        source = zenoh.SourceInfo(publisher.id, 0) if states else None

        def foreign() -> None:
            publisher.put(encode(replace(NEWEST, seq=due)), source_info=source)

        until(lambda: published(NEWEST))
        until(lambda: bool(foreign() or published(NEWEST)) and bus.refused.count > 0)
        assert {message.seq for message in heard if isinstance(message, Applied)} == {NEWEST.seq}
        assert "not from the actuator" in bus.refused.reason
        assert bus.refused.finding() is not None
        until(lambda: published(replace(NEWEST, seq=due)))
        sleep(1.2 * SILENT_S)
        heard.clear()
        foreign()  # it looks like the same program after a restart
        until(lambda: bool(heard) if states else bus.refused.count > 1)
        assert bool(heard) is states
    bus.close()


def _status(bus: ZenohBus, service: str) -> Status | None:
    try:
        return cast(Status, bus.call(STATUS[service], StatusRequest(), 0.5))
    except BusError:
        return None


def test_foreign_declarations_are_listed_and_those_of_programs_are_not(plain: Site) -> None:
    bus = ZenohBus(tool_endpoint(plain.rig), "demo", "doctor")
    plain.supervisor.announce("supervisor")
    until(lambda: "supervisor" in bus.alive())
    place = f"tcp/{plain.rig.bus.host}:{plain.rig.bus.port}"
    until(lambda: not bus.foreign_declarations())
    with outsider("peer", place) as session, declared(session, "silent", "**"):
        zid = str(session.zid())
        wanted = {("queryable", "**", zid), ("subscriber", "**", zid)}

        settle()

        def listed() -> bool:
            found = bus.foreign_declarations()
            return {(one.kind, one.place, one.session) for one in found} == wanted

        until(listed)
    until(lambda: not bus.foreign_declarations())
    bus.close()


def test_doctor_names_the_session_and_the_key_of_a_foreign_store(plain: Site) -> None:
    place = f"tcp/{plain.rig.bus.host}:{plain.rig.bus.port}"
    plain.supervisor.announce("supervisor")
    until(lambda: [one.mark for one in foreign_sessions(plain.rig)] == ["ok"])
    with outsider("client", place) as session, declared(session, "store"):
        settle()
        until(lambda: {one.mark for one in foreign_sessions(plain.rig)} == {"note"})
        found = [*foreign_sessions(plain.rig)]
        assert len(found) == 2
        assert all(str(session.zid()) in one.what and EVERYTHING in one.what for one in found)


@pytest.mark.parametrize("mode", [Mode.IDLE, None])
def test_doctor_reports_programs_of_a_running_rig_that_do_not_answer(
    plain: Site, monkeypatch: pytest.MonkeyPatch, mode: Mode | None
) -> None:
    """A device server whose port is taken keeps the sensor's program from starting."""
    monkeypatch.setattr(plain, "mode", mode)
    missing = [one.what for one in exchanges(plain.rig) if one.mark == "missing"]
    wanted = [plain.rig.sensor.url] + ([plain.rig.output.url] if mode is None else [])
    assert len(missing) == len(wanted)
    assert all(url in what for url, what in zip(wanted, missing, strict=True))


@pytest.mark.parametrize("mode", [Mode.ARMED, None])
def test_doctor_does_not_query_the_router_of_a_rig_in_use(
    plain: Site, monkeypatch: pytest.MonkeyPatch, mode: Mode | None
) -> None:
    def asked(_bus: ZenohBus) -> NoReturn:
        pytest.fail("the router was asked")

    monkeypatch.setattr(ZenohBus, "foreign_declarations", asked)
    monkeypatch.setattr(plain, "mode", mode)
    (found,) = foreign_sessions(plain.rig)
    assert found.mark == "note"
    assert plain.rig.rig.name in found.what


def test_doctor_does_not_query_a_router_shared_with_a_rig_in_use(
    plain: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = program_endpoint(plain.rig, "recorder", lockstep=False)
    other = ZenohBus(config, "other", "actuator")
    mode = Mode.ARMED

    def state(_: Request, _request: Message, reply: Reply) -> None:
        reply(Status("actuator", "", 1, "", 0, 0, 0, 0, mode=mode))

    other.serve(STATUS["actuator"], state)
    other.announce("actuator")
    until(lambda: [one.mark for one in foreign_sessions(plain.rig)] == ["note"])
    mode = Mode.LATCHED

    def none(_bus: ZenohBus) -> list[ForeignDeclaration]:
        return []

    monkeypatch.setattr(ZenohBus, "foreign_declarations", none)
    assert [one.mark for one in foreign_sessions(plain.rig)] == ["ok"]
    other.close()


def test_doctor_reports_no_foreign_sessions_if_the_bus_is_down_or_protected_by_access_lists(
    secure: Site,
) -> None:
    assert [*foreign_sessions(demo_rig())] == []
    assert [one.mark for one in foreign_sessions(secure.rig)] == ["ok"]
