"""A program that is alive but does not reply: the session is reopened, and the program
continues."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import threading
from collections.abc import Generator
from time import monotonic, sleep

import pytest
import zenoh

from pincette.bus import zenoh_bus
from pincette.bus.protocol import BusError, RefusalError
from pincette.bus.session import open_session
from pincette.bus.topology import SessionConfig, client_session, router_session
from pincette.bus.zenoh_bus import ZenohBus
from pincette.core.messages import Message, Position, StatusRequest
from pincette.core.messages.arms import ArmPosition
from pincette.core.topics import POSITION, STATUS, Topic, live_key, request_key
from tests.support.rigs import free_ports
from tests.support.routed import until

pytestmark = pytest.mark.usefixtures("stalls")

RIG = "contract"
ASK_S = 0.2
WAIT_S = 30.0


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> Generator[SessionConfig]:
    """Ends of a client whose waiting times are a fifth of the usual ones."""
    monkeypatch.setattr(zenoh_bus, "UNANSWERED_S", 0.6)
    port = free_ports(1)
    with open_session(router_session("127.0.0.1", port), "router"):
        yield client_session("127.0.0.1", port)


@pytest.fixture
def mute(ends: SessionConfig) -> Generator[zenoh.Session]:
    """Start an estimator that is alive but replies to no request."""
    kept: list[zenoh.Query] = []
    with open_session(ends, "mute") as session:
        token = session.liveliness().declare_token(live_key(RIG, "estimator"))
        place = request_key(RIG, STATUS["estimator"])
        queryable = session.declare_queryable(place, kept.append)
        yield session
        queryable.undeclare()
        token.undeclare()
        for query in kept:
            query.drop()


def unanswered(bus: ZenohBus, times: int) -> None:
    for _ in range(times):
        with pytest.raises(BusError, match="no answer within"):
            bus.call(STATUS["estimator"], StatusRequest(), ASK_S)


def sessions(bus: ZenohBus) -> str:
    return str(bus._session.info.zid())  # pyright: ignore[reportPrivateUsage]  it is what changes


@pytest.mark.usefixtures("mute")
def test_declarations_are_renewed_in_a_new_session(
    ends: SessionConfig, caplog: pytest.LogCaptureFixture
) -> None:
    bus, other = ZenohBus(ends, RIG, "supervisor"), ZenohBus(ends, RIG, "sensor")
    try:
        heard: list[int] = []
        seen: list[tuple[str, bool]] = []
        bus.announce("supervisor")
        bus.watch(lambda program, alive: seen.append((program, alive)))

        def hear(_topic: Topic, one: Message) -> None:
            assert isinstance(one, Position)
            heard.append(one.seq)

        bus.subscribe(POSITION, hear)
        bus.serve(STATUS["controller"], lambda _question, _request, reply: reply("not now"))
        before = sessions(bus)
        unanswered(bus, 2)
        assert sessions(bus) == before, "a silence of 0.4 s must not reopen the session"
        unanswered(bus, 2)
        after = sessions(bus)
        assert after != before
        assert "estimator is alive but does not answer" in caplog.text
        unanswered(bus, 5)
        assert sessions(bus) == after, (
            "the session must be reopened once and then not again for 30 s"
        )
        until(lambda: "supervisor" in other.alive())
        number = 0

        def told() -> bool:
            nonlocal number
            number += 1
            other.publish(
                Position(epoch=1, seq=number, t_s=0.0, arms=(ArmPosition(0.0, valid=True),))
            )
            return bool(heard)

        until(told)
        sleep(0.1)
        assert len(heard) == len(set(heard)), "each sample once"
        with pytest.raises(BusError, match="not now"):
            other.call(STATUS["controller"], StatusRequest(), 1.0)
        other.announce("sensor")
        until(lambda: ("sensor", True) in seen)
    finally:
        bus.close()
        other.close()


def test_links_of_the_previous_session_are_reported_as_closed(
    ends: SessionConfig, caplog: pytest.LogCaptureFixture, request: pytest.FixtureRequest
) -> None:
    caplog.set_level("INFO", "pincette")
    request.getfixturevalue("mute")

    def told() -> list[str]:
        """Return what the supervisor and the silent estimator report of their links with the
        router."""
        router = ends.connect[0].removeprefix("tcp/")
        return [one[: len("link up")] for one in caplog.messages if f"program at {router}" in one]

    bus = ZenohBus(ends, RIG, "supervisor")
    try:
        until(lambda: told() == ["link up"] * 2)
        before = sessions(bus)
        unanswered(bus, 4)
        assert sessions(bus) != before
        until(lambda: sorted(told()) == ["link do", *["link up"] * 3])
    finally:
        bus.close()
    assert sorted(told()) == [*["link do"] * 2, *["link up"] * 3]


@pytest.mark.usefixtures("mute")
def test_requests_during_a_reopening_get_a_reply_or_a_refusal(
    ends: SessionConfig,
) -> None:
    """A view of the rig has failed with an internal error, since a session was closed under it."""
    bus, other = ZenohBus(ends, RIG, "supervisor"), ZenohBus(ends, RIG, "controller")
    failures: list[BaseException] = []
    done = threading.Event()

    def ask() -> None:
        while not done.is_set():
            try:
                bus.publish(Position(epoch=1, seq=1, t_s=0.0, arms=(ArmPosition(0.0, valid=True),)))
                bus.latest(POSITION, ASK_S)
                bus.alive()
                bus.call(STATUS["controller"], StatusRequest(), ASK_S)
            except BusError:
                continue
            except Exception as error:  # noqa: BLE001  whatever it is
                failures.append(error)
                return

    threads = [threading.Thread(target=ask) for _ in range(4)]
    try:
        other.serve(STATUS["controller"], lambda _question, _request, reply: reply("not now"))
        before = sessions(bus)
        for thread in threads:
            thread.start()
        unanswered(bus, 4)
        assert sessions(bus) != before
    finally:
        done.set()
        for thread in threads:
            thread.join(WAIT_S)
        bus.close()
        other.close()
    assert failures == []
    with pytest.raises(BusError, match="session closed"):
        bus.call(STATUS["controller"], StatusRequest(), ASK_S)


@pytest.mark.usefixtures("mute")
def test_programs_that_reply_or_are_gone_do_not_cause_a_new_session(ends: SessionConfig) -> None:
    bus, other = ZenohBus(ends, RIG, "supervisor"), ZenohBus(ends, RIG, "controller")
    try:
        other.serve(STATUS["controller"], lambda _question, _request, reply: reply("not now"))
        before = sessions(bus)
        deadline = monotonic() + 1.5
        while monotonic() < deadline:
            with pytest.raises(BusError):
                bus.call(STATUS["controller"], StatusRequest(), ASK_S)
            with pytest.raises(BusError, match="is it running"):
                bus.call(STATUS["sensor"], StatusRequest(), ASK_S)
        assert sessions(bus) == before
    finally:
        bus.close()
        other.close()


@pytest.mark.parametrize("alive", [False, True])
def test_a_reply_while_the_tokens_are_queried_is_no_fault_and_causes_no_new_session(
    ends: SessionConfig, monkeypatch: pytest.MonkeyPatch, alive: bool
) -> None:
    """A program that links to a new router replies to one thread while another still waits."""
    bus, other = ZenohBus(ends, RIG, "supervisor"), ZenohBus(ends, RIG, "sensor")

    def replies_meanwhile(_bus: ZenohBus, _rig: str) -> set[tuple[str, str]]:
        other.serve(STATUS["sensor"], lambda _question, _request, reply: reply("not now"))
        with pytest.raises(RefusalError, match="not now"):
            bus.call(STATUS["sensor"], StatusRequest(), WAIT_S)
        return {(RIG, "sensor")} if alive else set()

    try:
        before = sessions(bus)
        monkeypatch.setattr(zenoh_bus, "UNANSWERED_S", 0.0)
        monkeypatch.setattr(ZenohBus, "_alive", replies_meanwhile)
        with pytest.raises(BusError, match="sensor"):
            bus.call(STATUS["sensor"], StatusRequest(), ASK_S)
        assert sessions(bus) == before
    finally:
        bus.close()
        other.close()
