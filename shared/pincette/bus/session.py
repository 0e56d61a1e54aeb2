"""Zenoh session of a program: opens it, protects its ports, logs its links, and serves a router."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import json
import logging
import os
import threading
from collections.abc import Callable, Mapping
from functools import partial
from time import monotonic
from typing import Any

import zenoh

from pincette.bus.guard import Guard
from pincette.bus.handshake import diagnose_link, is_taken
from pincette.bus.link_sweeper import LinkSweeper
from pincette.bus.own_sockets import LinkSockets, StallWatch
from pincette.bus.private_port import PrivatePort
from pincette.bus.protocol import BusError
from pincette.bus.refused_connections import RefusedConnections
from pincette.bus.settings import guarded, lease_s, settings
from pincette.bus.topology import SessionConfig, address_of
from pincette.bus.vouching import Vouching
from pincette.core.listening import bound

log = logging.getLogger("pincette")
CLOSE_S = 1.0
"""Time limit for closing a session while links accept no data, in s."""
GIVEN_UP_S = 0.2
"""Time limit for closing a session that no longer transmits anything, in s."""
AskRouter = Callable[[], None]
OWN_QUESTION = "@pincette/router"
"""Key of the query that a router sends to itself. Wildcards do not match a key segment that begins
with @.
"""
UNANSWERED_S = 3600.0
"""Zenoh's timeout of the query that a router sends to itself, in s. It is so long that the query
does not end before a reply."""
THREADS = "ZENOH_RUNTIME", "(rx:(worker_threads:1))"
"""Environment variable of Zenoh's threads, and its value: one thread that receives.

By default there are two receiving threads, which wake each other for most messages. Connections are
still accepted in another thread, since accepting may have to wait for the end of a connection.
"""
UNSIGNED = (
    "%s: this kernel signs no TCP segments (CONFIG_TCP_MD5SIG), so any account of this "
    "machine can keep others from connecting to this program"
)


class Joined:
    """A session, and the protection of its ports."""

    def __init__(
        self,
        session: "zenoh.Session",
        stalls: StallWatch,
        sweeper: LinkSweeper | None = None,
        guard: Guard | None = None,
    ) -> None:
        """``stalls`` ends links that accept none of the bytes sent to them.

        ``sweeper`` is for a session that listens, ``guard`` for one that listens with TLS.
        """
        self.session, self.guard = session, guard
        self._sweeper, self._stalls = sweeper, stalls
        self._sockets = LinkSockets(stalls)
        self._up: dict[tuple[str, str], tuple[float, str]] = {}
        """For each link, by Zenoh's names of its ends: the time at which it came up, and the
        program at the other end.
        """
        self._listener = session.info.declare_link_events_listener(self._note, history=True)

    @property
    def refused(self) -> RefusedConnections:
        """Return the number of connections rejected at the ports.

        Raises BusError if the session has no port.
        """
        watcher = self.guard or self._sweeper
        if watcher is None:
            raise BusError("a session that does not listen cannot refuse connections")
        return watcher.refused

    def _note(self, event: "zenoh.LinkEvent") -> None:
        """Log that a link has come up or gone down."""
        link, now_s = event.link, monotonic()
        ends = str(link.src), str(link.dst)
        end = ends[1].partition("/")[2]
        accepted = self.guard and self.guard.link_of(end)
        peer = f"{link.auth_identifier or 'a program'} at {accepted.origin if accepted else end}"
        if event.kind == zenoh.SampleKind.PUT:
            self._up[ends] = now_s, peer
            inodes = self._sockets.add(*ends)
            if self._sweeper is not None:
                self._sweeper.note_links(inodes)
            log.info("link up: %s", peer)
            return
        self._sockets.remove(*ends)
        why = (accepted.why if accepted else "") or "its lease has ended, or the link was closed"
        self._note_down(*self._up.pop(ends, (now_s, peer)), why)
        # A link that comes up before the previous one to the same place has ended carries none of
        # this session's declarations (Zenoh 1.10.2). Zenoh replaces it by one that carries them.
        for early in [other for other in self._up if other[1] == ends[1]]:
            log.warning("link to %s came up before the previous one had ended: made again", end)
            self._sockets.shut_down(early)

    def _note_down(self, since_s: float, peer: str, why: str) -> None:
        log.info("link down after %.1f s: %s: %s", monotonic() - since_s, peer, why)

    def __enter__(self) -> "zenoh.Session":
        return self.session

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self, limit_s: float = CLOSE_S) -> None:
        """Leave the bus, and log that the remaining links end with the session.

        Links that still exist after ``limit_s`` are ended by shutting down their sockets, since
        Zenoh waits for a partner that reads nothing, and may keep the sockets forever.
        """
        late = threading.Timer(limit_s, self._sockets.shut_down_all)
        late.daemon = True
        late.start()
        try:
            self._listener.undeclare()
            for since_s, peer in list(self._up.values()):
                self._note_down(since_s, peer, "closed here")
            if self.guard is not None:
                self.guard.close()
            self.session.close()
        except zenoh.ZError as error:  # Zenoh has waited for 10 s
            log.warning("a session could not be closed and is abandoned: %s", error)
        finally:
            late.cancel()
            if self._sweeper is not None:
                self._sweeper.close()
            self._stalls.close()
            self._sockets.close()

    def give_up(self) -> None:
        """Close a session that transmits nothing, without waiting."""
        limit = (GIVEN_UP_S,)
        threading.Thread(
            target=self.close, args=limit, name="session abandoned", daemon=True
        ).start()


def open_session(config: SessionConfig, name: str) -> Joined:
    """Open a session; raises BusError or SecurityError with the remedy."""
    # Zenoh's threads would write lines to standard output, and block if no program reads them.
    zenoh.init_log_from_env_or("off")
    os.environ.setdefault(*THREADS)
    stalls = StallWatch(lease_s(config))
    if not config.listen:
        return Joined(_opened(config, settings(config, name), name), stalls)
    if config.tls is not None:
        return _behind_guard(config, name, Vouching(config.tls.credentials), stalls)
    places = [address_of(place) for place in config.listen]
    try:
        for place in places:
            bound(*place).close()
    except OSError as error:
        raise _not_joined(config, name, error) from error
    session = _opened(config, settings(config, name), name)
    return Joined(session, stalls, _sweeping(session, [port for _, port in places]))


def _behind_guard(
    config: SessionConfig, name: str, vouching: Vouching, stalls: StallWatch
) -> Joined:
    """Open a session whose ports are served by a guard, with mutual TLS."""
    behind = PrivatePort.chosen()
    try:
        guard = Guard([address_of(place) for place in config.listen], behind, vouching, stalls)
    except OSError as error:
        raise _not_joined(config, name, error) from error
    try:
        session = _opened(config, guarded(config, name, behind, vouching), name)
        if not behind.close_to_others():
            log.warning(UNSIGNED, name)
        sweeper = _sweeping(session, [behind.port])
    except BusError:
        guard.close()
        raise
    guard.start()
    return Joined(session, stalls, sweeper, guard)


def _sweeping(session: "zenoh.Session", ports: list[int]) -> LinkSweeper:
    sweeper = LinkSweeper(ports)
    try:
        sweeper.start()
    except BusError:
        sweeper.close()
        session.close()
        raise
    return sweeper


def _opened(config: SessionConfig, tree: Mapping[str, Any], name: str) -> "zenoh.Session":
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(tree)))
    except zenoh.ZError as error:
        raise _not_joined(config, name, error) from error


def _not_joined(config: SessionConfig, name: str, error: Exception) -> BusError:
    if taken := [place for place in config.listen if is_taken(place)]:
        return BusError(
            f"{name}: {', '.join(taken)} is in use: by another rig, or by a second start of "
            "this rig? Stop it, or give this rig another [bus] port"
        )
    if isinstance(error, OSError):
        return BusError(f"{name}: {error.strerror or error}. In the rig file: [bus] host and port")
    files = config.tls.credentials if config.tls else None
    why = [trouble for place in config.connect if (trouble := diagnose_link(place, files))]
    return BusError(
        f"{name}: cannot join the bus (listen {', '.join(config.listen) or 'nowhere'}, "
        f"connect {', '.join(config.connect) or 'nowhere'}): {'; '.join(why) or error}"
    )


def serve_router(
    config: SessionConfig, rig: str, wait: Callable[[AskRouter], None], name: str = "router"
) -> None:
    """Route messages between the services of a rig and other tools until ``wait`` returns.

    The argument of ``wait`` is a function that queries this router and returns when it has replied.
    """
    with open_session(config, f"{rig}/{name}") as session:
        wait(partial(ask_router, session))


def ask_router(session: "zenoh.Session") -> None:
    """Query the router of a session for liveliness tokens; return when it has replied.

    The query needs the same locks of the routing tables as a new link or a message, and declares
    nothing that the router would forward to other sessions.
    """
    for _ in session.liveliness().get(OWN_QUESTION, timeout=UNANSWERED_S):
        pass
