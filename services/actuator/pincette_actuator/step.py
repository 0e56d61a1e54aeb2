"""The actuator as a service: commands and positions in, the instrument's voltage and what became
of the tick out."""

from dataclasses import replace
from typing import NamedTuple

from pincette.config import RigFile
from pincette.control.planning.sweep import SweptVoltages
from pincette.messages import Applied, Arm, Command, Done, Message, Position, Reset, Trip
from pincette.service import Drive, ForInstrument, Input, Look, RefusedError, Service, Wave
from pincette.topics import APPLIED, ARM, COMMAND, POSITION, RESET, STATUS, TRIP
from pincette_actuator.config import WAKE_PERIODS, ActuatorConfig, configure
from pincette_actuator.safety import (
    State,
    awake,
    newest_sample,
    objection,
    pass_time,
    refuse,
    reset,
    saw,
    take,
    trip,
    wind_down,
)

ANSWER_PERIODS = 0.75
"""A tick without a command by then is answered with the voltage that is kept."""

Outputs = tuple[Message | ForInstrument, ...]


class Inputs(NamedTuple):
    """``device`` is the text of an instrument's fault."""

    device: str | None
    command: Command | None
    position: Position | None


def start(config: ActuatorConfig) -> State:
    """Boot latched, at the safe voltage."""
    return State(voltage_V=config.safe_V)


def adopt(_config: ActuatorConfig, state: State, found_V: float) -> State:
    """Begin from what is put out: after a restart it is the voltage that the arm stands at."""
    return replace(state, voltage_V=found_V)


def step(config: ActuatorConfig, state: State, inputs: Inputs, now: float) -> tuple[State, Outputs]:
    """Take a command, note a sample, or let time pass."""
    state = awake(config, state, now)
    if inputs.device is not None:
        return _answer_tick(config, trip(config, state, f"device: {inputs.device}", now), now)
    if inputs.position is not None and inputs.position.epoch == state.epoch:
        state = saw(state, inputs.position.seq, now)
    command = inputs.command or state.pending
    if command is not None and command.epoch != state.epoch:
        # A controller that is not armed yet says of every sample that it commands nothing.
        stranger = refuse(state, f"command of epoch {command.epoch}")
        return stranger if command.valid else state, ()
    if command is not None and command.seq > newest_sample(state)[0]:
        return replace(state, pending=command), ()
    state = replace(state, pending=None)
    if command is not None:
        return _judge(config, state, command, now)
    if config.lockstep:
        return state, ()
    return _let_pass(config, state, now)


def _judge(
    config: ActuatorConfig, state: State, command: Command, now: float
) -> tuple[State, Outputs]:
    reason = objection(config, state, command, now) if command.valid else "no command"
    if not reason:
        taken = take(config, state, command, now)
        echo = _applied(taken, command.seq, now, command)
        return replace(taken, answered_seq=command.seq), (_order(taken, state), echo)
    state = refuse(state, reason) if command.valid else replace(state, blind=command.fault)
    if config.lockstep or (command.seq > state.answered_seq and not command.valid):
        return _answer_tick(config, pass_time(config, state, now), now)
    return state, ()


def _let_pass(config: ActuatorConfig, state: State, now: float) -> tuple[State, Outputs]:
    """In real time: the age limit, the ramp, and ticks that nobody commands."""
    later = pass_time(config, state, now)
    if later.mode != state.mode or later.voltage_V != state.voltage_V:
        return _answer_tick(config, later, now)
    seq, arrived_s = newest_sample(later)
    if seq > later.answered_seq and now - arrived_s >= ANSWER_PERIODS * config.period_s:
        return _answer_tick(config, later, now)
    return later, ()


def _answer_tick(config: ActuatorConfig, state: State, now: float) -> tuple[State, Outputs]:
    """Answer the newest tick without a command; in lockstep the write is what ends the tick."""
    seq = newest_sample(state)[0]
    echo = _applied(state, seq, now, None)
    moves = config.lockstep or state.mode not in ("idle", "frozen")
    outputs: Outputs = (_order(state, state), echo) if moves else (echo,)
    return replace(state, answered_seq=seq), outputs


def _order(state: State, before: State) -> ForInstrument:
    """What the instrument is told: a voltage ends a sweep, a sweep that it plays goes on."""
    if state.sweep is None:
        return Drive(state.voltage_V)
    if state.sweep == before.sweep:
        return Look()
    return Wave(SweptVoltages(state.sweep, state.voltage_V), state.sweep.rate_hz)


def _applied(state: State, seq: int, now: float, command: Command | None) -> Applied:
    return Applied(
        epoch=state.epoch,
        seq=seq,
        voltage_V=state.voltage_V,
        state=state.mode,
        cause=state.cause,
        limits_active=state.limits_active,
        part_held=state.part_held,
        zero=command is not None and command.zero,
        final=state.mode in ("idle", "latched"),
        answered=command is not None,
        refused=state.refused,
        command_age_s=now - state.fresh_s if command is not None else 0.0,
    )


def answer(
    config: ActuatorConfig, state: State, request: Message, now: float
) -> tuple[State, Message, Outputs]:
    """Arm, trip or reset."""
    if isinstance(request, Arm):
        if state.mode != "idle":
            hint = "reset it first" if state.mode == "latched" else "wait until it has ended"
            raise RefusedError(f"the actuator is {state.mode} ({state.cause or 'armed'}): {hint}")
        state = State(
            mode="armed",
            cause="",
            epoch=request.epoch,
            owner=request.owner,
            voltage_V=state.voltage_V,
            # Until the first command says otherwise: a fault before it must not drop the part.
            part_held=state.part_held,
            fresh_s=now + config.grace_s,
            ran_s=state.ran_s,
            standstills=state.standstills,
            refused=state.refused,
        )
        return state, Done(-1), (_applied(state, -1, now, None),)
    if isinstance(request, Trip):
        before, state = state, trip(config, state, request.cause, now, let_go=request.let_go)
        return state, Done(newest_sample(state)[0]), _told(config, before, state, now)
    if isinstance(request, Reset):
        return _reset(config, state, request, now)
    raise RefusedError(f"the actuator does not answer {type(request).__name__}")


def _told(config: ActuatorConfig, before: State, state: State, now: float) -> Outputs:
    """The state as it is; in lockstep a tick that is under way says it at its own end.

    There a voltage that has moved outside a tick is put out at once.
    """
    applied = _applied(state, newest_sample(state)[0], now, None)
    said = (applied,) if applied.final or not config.lockstep else ()
    moved = config.lockstep and applied.final and state.voltage_V != before.voltage_V
    return (Drive(state.voltage_V), *said) if moved else said


def _reset(
    config: ActuatorConfig, state: State, request: Reset, now: float
) -> tuple[State, Message, Outputs]:
    if not request.acknowledge:
        raise RefusedError("a reset needs acknowledge = true")
    if state.mode == "ramping" and not config.lockstep:
        raise RefusedError(
            f"the actuator is ramping ({state.cause}): reset it when the arm is safe"
        )
    after = reset(config, state)
    return after, Done(newest_sample(after)[0]), _told(config, state, after, now)


SERVICE: Service[RigFile, ActuatorConfig, State, Inputs] = Service(
    name="actuator",
    summary="authority, age, limits; freeze or ramp to the safe voltage; latch",
    inputs=(Input(COMMAND, "trigger"), Input(POSITION, "trigger")),
    outputs=(APPLIED,),
    questions=(ARM["actuator"], TRIP, RESET, STATUS["actuator"]),
    inputs_type=Inputs,
    configure=configure,
    start=start,
    step=step,
    answer=answer,
    instrument="voltage_output",
    wake_periods=WAKE_PERIODS,
    adopt=adopt,
    carried=("voltage_V", "part_held", "refused"),
    wind_down=wind_down,
)
