"""Events as bytes of a stream: what comes, a sign of life, and an end where a job is over."""

from collections.abc import AsyncGenerator, Callable
from time import monotonic

from fastapi.sse import format_sse_event

from pincette.api.event_models import Event
from pincette.api.states import STATES
from pincette_supervisor.running.events import LIFE_S, Listening

LOOK_S = 0.5
"""How often a stream of one job looks whether the job is over."""
GREETING, LIFE = b": listening\n", b": alive\n"
"""Comments; without an empty line, which some clients take for an event without data."""


def written(event: Event) -> bytes:
    """An event of a stream; one that has no number leaves the listener's last one as it is."""
    return format_sse_event(
        data_str=event.model_dump_json(),
        event=event.kind,
        id=None if event.number is None else str(event.number),
    )


async def endless(listening: Listening) -> AsyncGenerator[bytes]:
    """Until the log is closed."""
    try:
        yield GREETING
        while (events := await listening.next(LIFE_S)) is not None:
            for event in events:
                yield written(event)
            if not events and listening.caught_up:
                yield LIFE
    finally:
        listening.close()


async def until_over(
    listening: Listening, busy: Callable[[], bool], *, over: bool
) -> AsyncGenerator[bytes]:
    """Until a job is over and has told all of it.

    Parameters
    ----------
    busy
        Whether the job still has the rig; a stopped one has while it holds a part.
    over
        Whether its state was an end when the listening had begun.
    """
    spoke_at = monotonic()
    try:
        yield GREETING
        while True:
            # Looked at before what is told: what comes after an end is none of the job's.
            ended = over and not busy() and listening.caught_up
            events = await listening.next(0.0 if ended else LOOK_S)
            for event in events or ():
                over = over or _is_end(event)
                spoke_at = monotonic()
                yield written(event)
            if events is None or (ended and not events and listening.caught_up):
                return
            if not events and monotonic() - spoke_at > LIFE_S:
                spoke_at = monotonic()
                yield LIFE
    finally:
        listening.close()


def _is_end(event: Event) -> bool:
    state = event.body.get("state") if event.kind == "state" else None
    return any(name == state and entry.terminal for name, entry in STATES.items())
