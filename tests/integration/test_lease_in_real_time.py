"""Row 18 in virtual real time: the supervisor becomes silent in every state of a job."""

import pytest

from pincette.core.faults import TRIPPED, Acted, Mode
from pincette.core.messages import Lease, RequestLog, Telemetry
from pincette.core.wording import fault_text
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_places import EPOCH, STATES, T, place

LENGTH_S = 0.5
PLACES_IN_THE_PERIOD = (0.05, 0.35, 0.65, 0.95)
STOPPED_S = 0.5
"""Time within which a free arm is at rest after a stop of its program, with some ticks of
margin, in s."""
PLAYING = tuple(state for state in STATES if state not in ("idle", "stopping"))
LONG_S = 3.0


def granted(state: str, phase: float, length_s: float = LENGTH_S) -> VirtualLoop:
    """Return a loop in a state of its job, at some phase of its period, whose lease has just
    been granted."""
    loop = place(state).loop.fork(round(100 * phase))
    loop.run(loop.now_s + phase * T)
    loop.must("controller", Lease(EPOCH, length_s))
    return loop


def told(loop: VirtualLoop, since_s: float) -> list[tuple[float, Telemetry]]:
    messages = loop.told or []
    return [(at, one) for at, one in messages if isinstance(one, Telemetry) and at > since_s]


def asked(loop: VirtualLoop, since_s: float) -> list[tuple[float, RequestLog]]:
    """Return the actions that the controller has requested of itself."""
    found = [
        (at, one) for at, one in loop.told or [] if isinstance(one, RequestLog) and at > since_s
    ]
    return [(at, one) for at, one in found if one.action is not None and one.action.reason]


def tripped(loop: VirtualLoop, since_s: float) -> set[Mode]:
    return {echo.state for at, echo in loop.applied if at > since_s} & TRIPPED


@pytest.mark.parametrize("state", PLAYING)
def test_the_program_is_stopped_in_time_and_nothing_trips(state: str) -> None:
    for phase in PLACES_IN_THE_PERIOD:
        loop = granted(state, phase)
        begun_s = loop.now_s
        loop.run(begun_s + LENGTH_S + STOPPED_S)
        found = asked(loop, begun_s)
        if not found:  # the program came to its own end before
            assert loop.newest.final
            continue
        ((ended_s, noted),) = found
        assert LENGTH_S - T < ended_s - begun_s < LENGTH_S + 2.0 * T
        assert noted.action is not None
        assert fault_text(noted.action.reason).endswith("limit 0.5 s")
        acted = [one for _, one in told(loop, ended_s) if one.acted]
        assert [one.acted for one in acted] == [(Acted.LEASE, Acted.STOP)]
        assert acted[0].seq == noted.seq + 1
        loop.run(loop.now_s + LONG_S)
        assert not tripped(loop, begun_s)
        held = acted[0].held
        if held:
            assert loop.newest.state == "armed"
            assert loop.newest.part_held
        else:
            assert (loop.newest.state, loop.newest.final) == ("idle", True)


@pytest.mark.parametrize("state", ["approach", "hold", "paused"])
def test_a_supervisor_that_is_busy_for_most_of_the_lease_changes_nothing(state: str) -> None:
    loop = granted(state, 0.5)
    begun_s = loop.now_s
    for _ in range(6):
        loop.run(loop.now_s + 0.9 * LENGTH_S)
        if isinstance(loop.call("controller", Lease(EPOCH, LENGTH_S)), str):
            break  # the program has come to its own end
    assert not asked(loop, begun_s)
    assert not tripped(loop, begun_s)


def test_a_trip_ends_the_lease() -> None:
    loop = granted("hold", 0.3)
    begun_s = loop.now_s
    loop.kill("estimator")
    loop.run(begun_s + 4.0 * LENGTH_S)
    assert tripped(loop, begun_s)
    assert not asked(loop, begun_s)
