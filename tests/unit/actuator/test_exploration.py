"""Complete exploration of the latch: every state that sequences of good and bad periods can reach.

A move is one period: a sample or none, a command or none, a request or a fault, and time in
quarters of the period. States are distinguished by mode, voltage, part, ages and counts; the search
ends when no move reaches a new state.
"""

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import nan

from pincette.control.record import replace
from pincette.control.safety.arm import ArmLimits
from pincette.control.safety.voltage import VoltageLimits
from pincette.core.faults import Cause
from pincette.core.messages import Arm, Command, Message, Position, Reset, Trip
from pincette.core.messages.arms import ArmCommand, ArmPosition
from pincette.core.service import DeviceCommand, RefusedError, SetVoltage
from pincette_actuator.requests import handle
from pincette_actuator.state import State
from pincette_actuator.step import Inputs, start, step
from tests.support.arms import with_arm

from .bench import ARM, CONFIG, EPOCH, OFF, OWNER, WAKE, T

LIMITS = replace(
    CONFIG,
    age=replace(CONFIG.age, limit_s=0.03, limit_ticks=1, grace_s=0.01),
    # A quarter of the slew limit spans the range: smaller moves are tested separately.
    arms=(
        ArmLimits(
            VoltageLimits(min_V=-0.5, max_V=0.5, slew_V=4.0, sweep_V=0.1),
            replace(ARM.monitors, force_samples=2, position_samples=2),
        ),
    ),
    ramp_s=0.015,
    freeze_s=0.025,
)
VOLTAGE = LIMITS.arms[0].voltage
QUARTER_S = T / 4
Key = tuple[object, ...]
OLDEST = 7
"""Number of quarters beyond which an age makes no difference: every limit is below."""
FURTHEST = 3
"""Number of samples beyond which a distance makes no difference; otherwise waiting for a sample
that never comes would give a new state in every period."""
SAMPLES = ("good", "none", "invalid", "beyond")
COMMANDS: dict[str, dict[str, object]] = {
    "none": {},
    "up": {"voltage_V": 2.0},
    "down": {"voltage_V": -2.0, "part_held": True},
    "final": {"final": True, "part_held": True},
    "late": {"seq": -3},
    "early": {"seq": 1},
    "owner": {"owner": OWNER + 1, "voltage_V": 1.0},
    "epoch": {"epoch": EPOCH + 1, "voltage_V": 1.0},
    "nan": {"voltage_V": nan},
    "invalid": {"valid": False},
    "pressing": {"force_mN": 99.0},
}
REQUESTS: dict[str, Message | str] = {
    "device": "device",
    "estop": Trip(Cause.ESTOP),
    "let_go": Trip(Cause.ABORT, release_now=True),
    "reset": Reset(acknowledge=True),
    "unacknowledged": Reset(),
    "arm": Arm(EPOCH, OWNER, ""),
}
MOVES = (
    *((sample, command, "") for sample, command in product(SAMPLES, COMMANDS)),
    *((sample, "up", question) for sample, question in product(("good", "none"), REQUESTS)),
)
"""Sample, command, question."""
LEADS_TO = {
    "latched": {"latched", "idle", "ramping", "frozen"},
    "idle": {"idle", "armed", "ramping", "frozen"},
    "armed": {"armed", "idle", "ramping", "frozen"},
    "frozen": {"frozen", "ramping", "idle"},
    "ramping": {"ramping", "latched"},
}


@dataclass(frozen=True)
class Place:
    """A state, and the present time and sample number."""

    state: State
    quarter: int
    seq: int

    @property
    def now(self) -> float:
        return self.quarter * QUARTER_S

    def key(self) -> Key:
        """States that the rules distinguish."""
        state = self.state

        def age(since_s: float) -> int:
            return min(OLDEST, round((self.now - since_s) / QUARTER_S))

        seen = tuple(
            (self.seq - sample.seq, age(sample.at_s))
            for sample in state.arrivals
            if age(sample.at_s) < OLDEST
        )
        return (
            state.mode,
            state.cause == "boot",
            round(state.arms[0].voltage_V, 6),
            state.part_held,
            age(state.fresh_s) if state.mode == "armed" else 0,
            age(state.since_s) if state.mode in ("frozen", "ramping") else 0,
            round(state.arms[0].ramp_from_V, 6) if state.mode == "ramping" else 0,
            seen,
            min(FURTHEST, self.seq - state.taken_seq),
            min(2, self.seq - state.answered_seq),
            None
            if (waits := state.pending) is None
            else (min(FURTHEST, self.seq - waits.seq), waits.valid),
            (state.arms[0].watches.force.count, state.arms[0].watches.position.count),
            state.unconfirmed,
        )


@dataclass(frozen=True)
class Seen:
    """One event: the states before and after it, and the outputs."""

    event: str
    before: State
    after: State
    outputs: tuple[Message | DeviceCommand, ...]


def moved(place: Place, sample: str, command: str, question: str) -> Iterator[tuple[Place, Seen]]:
    """Play a period, event by event."""
    state, quarter, seq = place.state, place.quarter, place.seq

    def after(event: str, inputs: Inputs) -> tuple[Place, Seen]:
        nonlocal state
        before = state
        state, outputs = step(LIMITS, before, inputs, quarter * QUARTER_S)
        return Place(state, quarter, seq), Seen(event, before, state, outputs)

    if sample != "none":
        x_um = 900.0 if sample == "beyond" else 1.0
        seen = Position(EPOCH, seq, 0.0, (ArmPosition(x_um, valid=sample != "invalid"),))
        yield after(f"{sample} sample", Inputs(None, None, seen))
    quarter += 1
    if command == "none":
        yield after("wake", WAKE)
    else:
        changes = dict(COMMANDS[command])
        number = seq + int(str(changes.pop("seq", 0)))
        good = Command(EPOCH, number, OWNER, (ArmCommand(0.5),), False, False, False, True)
        yield after(command, Inputs(None, with_arm(good, **changes), None))
    for _ in range(2):
        quarter += 1
        yield after("wake", WAKE)
    request = REQUESTS.get(question)
    if request == "device":
        yield after("device", Inputs(OFF, None, None))
    elif request is not None:
        assert not isinstance(request, str)
        before = state
        try:
            state, _, outputs = handle(LIMITS, before, request, quarter * QUARTER_S)
        except RefusedError:
            outputs = ()
        if question == "arm" and state is not before:
            seq = -1
        yield Place(state, quarter, seq), Seen(question, before, state, outputs)
    quarter += 1
    seq += 1
    yield after("wake", WAKE)


def check(seen: Seen) -> None:
    """Check the rules that hold for every event in every state."""
    event, before, after = seen.event, seen.before, seen.after
    (old,), (new,) = before.arms, after.arms
    change_V = new.voltage_V - old.voltage_V
    assert after.mode in LEADS_TO[before.mode], seen
    assert VOLTAGE.min_V <= new.voltage_V <= VOLTAGE.max_V
    if (before.mode, after.mode) in (("latched", "idle"), ("frozen", "idle")):
        assert event == "reset" or (event, before.cause) == ("unacknowledged", "boot")
    if before.mode != "armed" and after.mode == "armed":
        assert (before.mode, event) == ("idle", "arm")
    if after.taken_seq > before.taken_seq:
        assert before.mode == "armed"
        assert event not in ("owner", "epoch", "nan", "invalid", "late")
        assert abs(change_V) <= VOLTAGE.slew_V + 1e-12
    elif after.mode in ("ramping", "latched") and before.mode != "latched":
        # The first step is early by a quarter of its own duration, whether it comes with the trip
        # or after.
        begins = before.mode != "ramping" or old.voltage_V == old.ramp_from_V
        ahead = 2 if begins else 1
        span_V = abs(new.ramp_from_V - LIMITS.safe_V)
        assert abs(change_V) <= span_V * ahead * QUARTER_S / LIMITS.ramp_s + 1e-9
        assert abs(new.voltage_V - LIMITS.safe_V) <= abs(old.voltage_V - LIMITS.safe_V)
    else:
        assert change_V == 0.0, seen
    for output in seen.outputs:
        if isinstance(output, SetVoltage):
            assert output.voltages_V == (new.voltage_V,)


def explored() -> tuple[dict[Key, Place], Counter[tuple[str, str]]]:
    """Return every reachable state, and how often one mode followed another."""
    first = Place(start(LIMITS), 0, 0)
    met = {first.key(): first}
    led: Counter[tuple[str, str]] = Counter()
    open_places = deque([first])
    while open_places:
        place = open_places.popleft()
        for move in MOVES:
            events = list(moved(place, *move))
            for _, seen in events:
                check(seen)
                led[seen.before.mode, seen.after.mode] += 1
            end = events[-1][0]
            if end.key() not in met:
                met[end.key()] = end
                open_places.append(end)
    return met, led


def check_latched(place: Place) -> None:
    """Check that after a trip, until a reset, every state moves to the safe voltage and stays
    there."""
    here = place
    for _ in range(8):
        events = list(moved(here, "good", "up", "arm"))
        for _, seen in events:
            assert seen.after.mode in ("frozen", "ramping", "latched")
            assert seen.after.taken_seq == place.state.taken_seq
        here = events[-1][0]
    if here.state.mode != "latched" or place.state.mode != "latched":
        assert here.state.mode == "latched"
        # An output that never reports its voltage is written no more, and reported as unconfirmed.
        assert here.state.arms[0].voltage_V == LIMITS.safe_V or here.state.unconfirmed


def test_no_event_in_any_state_breaks_a_rule_and_only_a_reset_ends_a_trip() -> None:
    met, led = explored()
    assert len(met) > 1_000
    assert {place.state.mode for place in met.values()} == set(LEADS_TO)
    never = {("latched", "frozen")}
    assert set(led) == {(a, b) for a in LEADS_TO for b in LEADS_TO[a]} - never
    tripped = [
        place
        for place in met.values()
        if place.state.mode in ("frozen", "ramping", "latched") and place.state.cause != "boot"
    ]
    assert tripped
    for place in tripped:
        check_latched(place)
