"""Unexpected behaviour of Zenoh: each row of the table in `wire.md`.

No code of this project is involved. A test that fails after an update of Zenoh shows that its row,
and the code that relies on it, is out of date.
"""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

import json
import re
import threading
from collections import Counter
from collections.abc import Callable, Generator, Iterable
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path
from time import monotonic, sleep
from typing import Any, cast

import pytest
import zenoh

from tests.support.rigs import free_ports
from tests.support.routed import until

KEY = "rig/actuator/trip"
SLOW_S = 0.5
WAIT_S = 5.0
ALL, NONE = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
PAGE = Path(__file__).parents[2] / "docs/explanations/wire.md"


def opened(mode: str, listen: str = "", connect: str = "", **more: Any) -> zenoh.Session:
    tree = {
        "mode": mode,
        "listen": {"endpoints": [listen] if listen else []},
        "connect": {"endpoints": [connect] if connect else []},
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}},
        **more,
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(tree)))


class Net:
    """A router, and sessions at it."""

    def __init__(self, stack: ExitStack, **router: Any) -> None:
        self._stack = stack
        self._place = f"tcp/127.0.0.1:{free_ports(1)}"
        settings: dict[str, Any] = {"timestamping": {"enabled": False}, **router}
        self.router = stack.enter_context(opened("router", self._place, **settings))

    def join(self, mode: str, **more: Any) -> zenoh.Session:
        return self._stack.enter_context(opened(mode, connect=self._place, **more))

    def serve(
        self, session: zenoh.Session, key: str, reply: Callable[[Any], object], **how: Any
    ) -> None:
        def take(query: zenoh.Query) -> None:
            with query:
                reply(query)

        self._stack.enter_context(session.declare_queryable(key, take, **how))


@pytest.fixture
def net() -> Generator[Net]:
    with ExitStack() as stack:
        yield Net(stack)


def replies(session: zenoh.Session, key: str = KEY, **how: Any) -> list[bytes]:
    found = cast("Iterable[zenoh.Reply]", session.get(key, timeout=WAIT_S, **how))
    return [reply.ok.payload.to_bytes() for reply in found if reply.ok is not None]


def known(session: zenoh.Session, count: int, key: str = KEY) -> None:
    """Wait until a session reaches all queryables on a key."""
    until(lambda: len(replies(session, key, target=ALL, consolidation=NONE)) >= count)


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_a_queryable_declared_complete_answers_queries_for_the_key_of_another_program(
    net: Net, mode: str
) -> None:
    program, store, asker = (net.join(mode if place < 2 else "client") for place in range(3))
    net.serve(program, KEY, lambda query: query.reply(KEY, b"program"))
    net.serve(store, "rig/**", lambda query: query.reply(KEY, b"store"), complete=True)
    known(asker, 2)
    assert replies(asker) == [b"store"]
    assert sorted(replies(asker, target=ALL, consolidation=NONE)) == [b"program", b"store"]


def test_a_stamped_reply_is_kept_and_a_newer_one_without_a_timestamp_dropped(net: Net) -> None:
    program, store, asker = (net.join("client") for _ in range(3))
    old = store.new_timestamp()
    net.serve(store, KEY, lambda query: query.reply(KEY, b"old", timestamp=old))
    net.serve(program, KEY, lambda query: query.reply(KEY, b"new"))
    known(asker, 2)
    for _ in range(5):
        assert replies(asker, target=ALL) == [b"old"]
    assert sorted(replies(asker, target=ALL, consolidation=NONE)) == [b"new", b"old"]


def test_a_query_of_a_key_with_several_producers_returns_one_reply(net: Net) -> None:
    asker = net.join("client")
    for number in range(4):
        payload = str(number).encode()
        net.serve(net.join("client"), KEY, lambda query, one=payload: query.reply(KEY, one))
    known(asker, 4)
    assert len(replies(asker)) == 1
    assert len(replies(asker, target=ALL)) == 1
    assert len(replies(asker, target=ALL, consolidation=NONE)) == 4


def test_the_slowest_queryable_delays_all_replies_to_a_wildcard(net: Net) -> None:
    quick, slow, asker = (net.join("client") for _ in range(3))
    released = threading.Event()

    def wait(query: zenoh.Query) -> None:
        released.wait(SLOW_S)
        query.reply("rig/b", b"slow")

    net.serve(quick, "rig/a", lambda query: query.reply("rig/a", b"quick"))
    net.serve(slow, "rig/b", wait)
    released.set()
    known(asker, 2, "rig/*")
    released.clear()

    def first_s(**how: Any) -> float:
        begun_s = monotonic()
        found = iter(cast("Iterable[Any]", asker.get("rig/*", timeout=WAIT_S, **how)))
        first = next(found).ok.payload.to_bytes()
        took_s = monotonic() - begun_s
        assert {first, next(found).ok.payload.to_bytes()} == {b"quick", b"slow"}
        return took_s

    assert first_s() >= SLOW_S
    assert first_s(consolidation=NONE) < 0.5 * SLOW_S


def test_a_queryable_that_never_finishes_ends_a_query_at_its_timeout_as_an_error(net: Net) -> None:
    kept: list[zenoh.Query] = []
    mute, asker = net.join("client"), net.join("client")
    declared = mute.declare_queryable(KEY, kept.append)
    until(lambda: bool(list(cast("Iterable[Any]", asker.get(KEY, timeout=0.1))) or kept))
    replies = list(cast("Iterable[zenoh.Reply]", asker.get(KEY, timeout=0.2)))
    # One or more: each part of the network that waits for the queryable may report it.
    assert replies
    assert {reply.err and reply.err.payload.to_bytes() for reply in replies} == {b"Timeout"}
    for query in kept:
        query.drop()
    declared.undeclare()


def test_a_liveliness_token_with_wildcards_is_found_among_those_it_intersects(net: Net) -> None:
    program, tool, asker = (net.join("client") for _ in range(3))
    places = {"rig/live/arm", "rig/**", "**"}
    tokens = [
        session.liveliness().declare_token(place)
        for session, place in ((program, "rig/live/arm"), (tool, "rig/**"), (tool, "**"))
    ]

    def found() -> set[str]:
        replies = cast("Iterable[zenoh.Reply]", asker.liveliness().get("rig/live/*"))
        return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

    until(lambda: found() == places)
    heard: set[str] = set()
    subscriber = asker.liveliness().declare_subscriber(
        "rig/live/*", lambda sample: heard.add(str(sample.key_expr)), history=True
    )
    until(lambda: heard == places)
    subscriber.undeclare()
    for token in tokens:
        token.undeclare()


def test_a_sample_states_a_session_only_if_its_sender_states_one_which_may_be_false(
    net: Net,
) -> None:
    program, tool, listener = (net.join("client") for _ in range(3))
    stated: dict[bytes, Any] = {}

    def take(sample: zenoh.Sample) -> None:
        stated[sample.payload.to_bytes()] = sample.source_info

    subscriber, publisher = listener.declare_subscriber(KEY, take), program.declare_publisher(KEY)
    source = zenoh.SourceInfo(publisher.id, 0)
    until(lambda: bool(publisher.put(b"none") or b"none" in stated))
    until(lambda: bool(publisher.put(b"own", source_info=source) or b"own" in stated))
    copied = stated[b"own"]
    until(lambda: bool(tool.put(KEY, b"copied", source_info=copied) or b"copied" in stated))
    assert stated[b"none"] is None
    sessions = {stated[name].source_id.zid for name in (b"own", b"copied")}
    assert sessions == {program.zid()} != {tool.zid()}
    subscriber.undeclare()


def test_a_downsampling_rule_has_one_clock_for_all_keys_it_covers() -> None:
    """Of two topics that are published one after the other, the second one is dropped."""

    def heard(*keys: str) -> Counter[str]:
        counted: Counter[str] = Counter()
        rules = [{"key_expr": key, "freq": 20.0} for key in keys]
        limits = {"messages": ["put"], "flows": ["egress"], "rules": rules}
        with ExitStack() as stack:
            net = Net(stack, downsampling=[limits])
            source, listener = net.join("client"), net.join("client")

            def arrives(sample: zenoh.Sample) -> None:
                counted.update([str(sample.key_expr)])

            stack.enter_context(listener.declare_subscriber("rig/*", arrives))
            first, second = (source.declare_publisher(f"rig/{name}") for name in "ab")
            publishers: list[Any] = [first, second]
            until(lambda: all(one.matching_status.matching for one in publishers))
            for _ in range(200):
                first.put(b"")
                second.put(b"")
                sleep(0.005)
            sleep(0.1)
        return counted

    together, each = heard("rig/*"), heard("rig/a", "rig/b")
    assert together["rig/b"] < 0.5 * together["rig/a"]
    assert each["rig/b"] > 0.7 * each["rig/a"]


def test_only_routers_add_timestamps_to_samples() -> None:
    def stamped(**router: Any) -> bool:
        seen: list[Any] = []
        with ExitStack() as stack:
            net = Net(stack, **router)
            source, listener = net.join("client"), net.join("client")
            stack.enter_context(listener.declare_subscriber(KEY, seen.append))
            until(lambda: bool(source.put(KEY, b"") or seen))
        return seen[0].timestamp is not None

    assert stamped(timestamping={}), "Zenoh's default"
    assert not stamped(timestamping={"enabled": False})


def test_the_page_states_the_version_and_names_every_test() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert f"Zenoh {version('eclipse-zenoh')}" in page
    named = set(re.findall(r"`(test_\w+)`", page))
    here = {name for name in globals() if name.startswith("test_") and "page" not in name}
    assert named == here
