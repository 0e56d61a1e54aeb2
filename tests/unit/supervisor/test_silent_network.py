"""When a supervisor that the bus does not carry restarts itself."""

import pytest

from pincette_supervisor.program import MOST_DOUBLED, RESTARTS, UNHEARD_S, LoopbackWatch


class Bus:
    """A bus controlled by the test, with its clock."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.carries = self.takes_links = True
        self.restarts: list[float] = []
        self.watch = LoopbackWatch(
            lambda: self.carries,
            lambda: self.takes_links,
            self.restarts.append,
            lambda: self.now_s,
        )

    def passes(self, time_s: float) -> None:
        self.now_s += time_s
        self.watch.ask()
        self.watch.look()


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Bus:
    monkeypatch.delenv(RESTARTS, raising=False)
    return Bus()


def test_a_supervisor_that_receives_its_messages_is_never_restarted(bus: Bus) -> None:
    for _ in range(100):
        bus.passes(UNHEARD_S)
    assert bus.restarts == []


def test_a_supervisor_without_its_messages_is_restarted_after_the_limit(bus: Bus) -> None:
    bus.carries = False
    bus.passes(UNHEARD_S)
    assert bus.restarts == []
    bus.passes(1.0)
    assert bus.restarts == [UNHEARD_S + 1.0]


def test_a_query_that_never_returns_counts_as_silence(bus: Bus) -> None:
    bus.now_s += UNHEARD_S + 1.0
    bus.watch.look()
    assert len(bus.restarts) == 1


def test_a_supervisor_continues_while_no_router_accepts_links(bus: Bus) -> None:
    bus.carries = bus.takes_links = False
    bus.passes(100.0 * UNHEARD_S)
    assert bus.restarts == []
    bus.takes_links = True
    bus.passes(1.0)
    assert len(bus.restarts) == 1


def test_each_restart_without_success_doubles_the_time_until_the_next(
    bus: Bus, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus.carries = False
    for before in range(MOST_DOUBLED + 3):
        monkeypatch.setenv(RESTARTS, str(before))
        limit_s = UNHEARD_S * 2 ** min(before, MOST_DOUBLED)
        later = Bus()
        later.carries = False
        later.passes(limit_s)
        assert later.restarts == []
        later.passes(1.0)
        assert later.restarts == [limit_s + 1.0]


def test_after_a_received_message_the_shortest_time_until_a_restart_applies(
    bus: Bus, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(RESTARTS, "3")
    bus.passes(1.0)
    bus.carries = False
    bus.passes(UNHEARD_S + 1.0)
    assert len(bus.restarts) == 1
