"""The actuator as a service: commands and positions in, the voltage and the outcome of each tick
out."""

from msgspec.structs import replace

from pincette.config import RigFile
from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.record import FrozenRecord
from pincette.control.safety.admission import (
    CommandFacts,
    authority_fault,
    is_future,
    judged,
    reject,
    sampled,
)
from pincette.control.safety.arm import ArmOutput
from pincette.control.safety.causes import AT_REST, Cause, Mode
from pincette.control.safety.confirmation import (
    begun,
    failed,
    found,
    needs_no_write,
    read_back_due,
    suspended,
    waits_for_read_back,
)
from pincette.control.safety.freshness import newest_seq, skipped_seq
from pincette.control.safety.latch import (
    account_for_stall,
    booted,
    ending,
    explained,
    pass_time,
    shutdown,
    trip,
)
from pincette.control.safety.state import SafetyLimits
from pincette.control.safety.watchdog_feed import may_kick_watchdog
from pincette.core.idle_sampling import SAMPLE_S
from pincette.core.messages import Command, Message, Position
from pincette.core.service import Busy, DeviceCommand, Input, PutOut, ReadBack, Service, Slept
from pincette.core.topics import APPLIED, ARM, COMMAND, POSITION, RESET, STATUS, TIMING_OF, TRIP
from pincette_actuator.config import configure
from pincette_actuator.requests import handle
from pincette_actuator.state import State, applied_of, facts_of, order_of, step_of, voltages_of

ANSWER_PERIODS = 0.75
"""Time, in periods, after which a tick without a command ends with an unchanged voltage. At rest no
command is accepted, so the tick ends at once.
"""

Outputs = tuple[Message | DeviceCommand, ...]


class Inputs(FrozenRecord, frozen=True):
    """Inputs of a step.

    ``device`` is the instrument's fault, its reported voltages, or a delay that kept the program
    from checking its clock.
    """

    device: Fault | PutOut | Slept | Busy | None
    command: Command | None
    position: Position | None


def start(limits: SafetyLimits) -> State:
    """Start latched, with each arm at the safe voltage."""
    return State(arms=tuple(ArmOutput(limits.safe_V) for _ in limits.arms))


def initialize_from_output(limits: SafetyLimits, state: State, found_V: tuple[float, ...]) -> State:
    """Start from the voltages found at the output, after a restart or a reset."""
    return begun(limits, state, found_V)


def step(limits: SafetyLimits, state: State, inputs: Inputs, now: float) -> tuple[State, Outputs]:
    """Process a command, a sample, or the passing of time."""
    said, busy_s = inputs.device, 0.0
    if said is not None and isinstance(said, Busy):
        said, busy_s = None, said.busy_s
    state = before = account_for_stall(limits, state, now, busy_s)
    if said is not None:
        return _device_said(limits, state, said, now)
    skipped = -1
    if (position := inputs.position) is not None and position.epoch == state.epoch:
        skipped = skipped_seq(state.arrivals, position.seq)
        state = sampled(limits, state, position.seq, _measured(position), now).settled()
        for arm in position.arms:
            if arm.fault is not None:
                state = explained(state, arm.fault)
    command, facts = state.pending, None
    if inputs.command is not None:
        state, command, facts = _heard(state, inputs.command)
    elif command is not None:
        facts = facts_of(command)
    if command is not None and facts is not None and not is_future(state, facts):
        if state.pending is not None:
            state = replace(state, pending=None)
        state, outputs = _judge(limits, state, command, facts, now)
    else:
        if command is not state.pending:
            state = replace(state, pending=command)
        if limits.lockstep:
            return state, ()
        state, outputs = _let_pass(limits, before, state, now)
    if skipped < 0 or skipped == state.taken_seq:
        return state, outputs
    # The estimate of a sample needs the voltage of the previous tick, even if that tick was
    # skipped.
    return state, (*outputs[:-1], applied_of(state, skipped), *outputs[-1:])


def _measured(position: Position) -> tuple[float | None, ...]:
    measured: list[float | None] = []
    for arm in position.arms:
        measured.append(arm.x_um if arm.valid else None)
    return tuple(measured)


def _device_said(
    limits: SafetyLimits, state: State, said: Fault | PutOut | Slept, now: float
) -> tuple[State, Outputs]:
    """Trip on a fault of the output and request its voltage; continue from the voltages it
    reports."""
    if isinstance(said, Slept):
        state = suspended(limits, state, said.slept_s, now)
        return _answer_tick(limits, state, now)
    if isinstance(said, PutOut):
        state = found(limits, state, said.voltages_V, now).settled()
        return state, (applied_of(state, newest_seq(state.arrivals)),)
    if waits_for_read_back(limits, state) and said.code is FaultCode.INSTRUMENT_INVALID:
        # The output cannot report its voltage, which is assumed to be the last commanded one.
        return _device_said(limits, state, PutOut(voltages_of(state)), now)
    state = _unconfirmed(state, said)
    state = trip(limits, state, Cause.DEVICE, now, faults=(said,))
    state, outputs = _answer_tick(limits, failed(state), now)
    return failed(state), outputs


def _unconfirmed(state: State, device: Fault) -> State:
    """Add to the faults of a freeze that the output no longer confirms its voltage; do so only
    once.
    """
    unconfirmed = any(one.code is FaultCode.OUTPUT_UNCONFIRMED for one in state.faults)
    if state.mode != Mode.FROZEN or state.cause == Cause.DEVICE or unconfirmed:
        return state
    doubt = fault(FaultCode.OUTPUT_UNCONFIRMED, device.words)
    return replace(state, faults=(*state.faults, doubt))


def _heard(state: State, command: Command) -> tuple[State, Command | None, CommandFacts | None]:
    """Return the state, and the command to judge with its facts: the new one, or the waiting one.

    A command without authority, or a repeated command, is rejected and leaves the waiting command
    in place.
    """
    facts, waits = facts_of(command), state.pending
    if why := authority_fault(state, facts):
        state = reject(state, facts, why)
    elif waits is not None and (waits.epoch, waits.seq) >= (command.epoch, command.seq):
        why = fault(FaultCode.COMMAND_REPEATED, seq=command.seq, taken_seq=waits.seq)
        state = replace(state, refused=state.refused + 1, refusal=why)
    else:
        return state, command, facts
    return state, waits, None if waits is None else facts_of(waits)


def _judge(
    limits: SafetyLimits, state: State, command: Command, facts: CommandFacts, now: float
) -> tuple[State, Outputs]:
    after = judged(limits, state, facts, now)
    if after.taken_seq != state.taken_seq:
        taken = replace(
            after, sweep=command.sweep, answered_seq=command.seq, unconfirmed=False
        ).settled()
        if state.sweep is not None:
            # The voltage within a sweep is not known, so the step that ends the sweep is output in
            # one part.
            taken = replace(taken, shaped=None)
        parts_s = 0.0 if taken.shaped is None else limits.parts_s
        return taken, (
            order_of(taken, state) if taken.shaped is None else step_of(limits, taken.shaped),
            applied_of(taken, command.seq, command, now - taken.fresh_s + parts_s),
        )
    unasked = command.seq > state.answered_seq and not command.valid
    if limits.lockstep or unasked:
        return _answer_tick(limits, pass_time(limits, after, now), now)
    return _let_pass(limits, state, after, now)


def _let_pass(
    limits: SafetyLimits, before: State, state: State, now: float
) -> tuple[State, Outputs]:
    """Apply the age limit and the ramp in real time, and answer ticks without a command."""
    later = pass_time(limits, state, now)
    moved = later.arms is not before.arms and voltages_of(later) != voltages_of(before)
    if moved or later.mode != before.mode:
        return _answer_tick(limits, later, now)
    if read_back_due(limits, later, now):
        return _answer_tick(limits, later, now)
    if not later.arrivals or later.arrivals[-1].seq <= later.answered_seq:
        return later, ()
    waits = later.mode not in AT_REST
    if waits and now - later.arrivals[-1].at_s < ANSWER_PERIODS * limits.period_s:
        return later, ()
    return _answer_tick(limits, later, now)


def _answer_tick(limits: SafetyLimits, state: State, now: float) -> tuple[State, Outputs]:
    """End the newest tick without a command; in lockstep the write ends the tick."""
    state = state.settled()
    seq = newest_seq(state.arrivals)
    echo = applied_of(state, seq)
    if waits_for_read_back(limits, state):
        asks = read_back_due(limits, state, now)
        state = replace(state, answered_seq=seq, asked_s=now if asks else state.asked_s)
        return state, (ReadBack(), echo) if asks else (echo,)
    if limits.lockstep or not needs_no_write(state):
        state = replace(
            state,
            answered_seq=seq,
            unconfirmed=False,
            located=False,
            shaped=None,
            interrupted=False,
        )
        return state, (order_of(state, state), echo)
    return replace(state, answered_seq=seq), (echo,)


def _wake_s(limits: SafetyLimits) -> float:
    return limits.age.wake_s


def _timer_s(limits: SafetyLimits, state: State) -> float:
    """Return the time to the next check of the clock, in s. It is longer at rest, where no command
    ages and no voltage changes.
    """
    if state.mode in AT_REST and not waits_for_read_back(limits, state):
        return max(SAMPLE_S, limits.age.wake_s)
    return limits.age.wake_s


def _shutdown(limits: SafetyLimits, state: State, now: float) -> tuple[State, bool]:
    state, at_rest = shutdown(limits, state, now)
    return state.settled(), at_rest


SERVICE: Service[RigFile, SafetyLimits, State, Inputs] = Service(
    name="actuator",
    summary="authority, age, limits; freeze or ramp to the safe voltage; latch",
    inputs=(Input(COMMAND, "trigger"), Input(POSITION, "trigger")),
    outputs=(APPLIED,),
    requests=(ARM["actuator"], TRIP, RESET, STATUS["actuator"], TIMING_OF["actuator"]),
    inputs_type=Inputs,
    configure=configure,
    start=start,
    step=step,
    handle=handle,
    instrument="voltage_output",
    wake_s=_wake_s,
    timer_s=_timer_s,
    initialize_from_output=initialize_from_output,
    booted=booted,
    ending=ending,
    state_snapshot=("arms", "part_held", "refused"),
    shutdown=_shutdown,
    may_kick_watchdog=may_kick_watchdog,
)
