"""Between messages and rules: a command as an offer, the state as ``applied`` and as an order."""

from pincette.control.safety.admission import Offer
from pincette.messages import Applied, Command
from pincette.service import Drive, ForInstrument, Look, Wave
from pincette_actuator.state import State


def offer_of(command: Command) -> Offer:
    """A command as the rules see it."""
    return Offer(
        epoch=command.epoch,
        owner=command.owner,
        seq=command.seq,
        voltage_V=command.voltage_V,
        part_held=command.part_held,
        final=command.final,
        valid=command.valid,
        fault=command.fault,
        force_mN=command.force_mN,
        x_d_um=command.x_d_um,
        sweep_V=None if command.sweep is None else command.sweep.amplitude_V,
    )


def applied_of(
    state: State, seq: int, command: Command | None = None, age_s: float = 0.0
) -> Applied:
    """What became of tick ``seq``; ``command`` is the one that was taken for it, at that age."""
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
        command_age_s=age_s,
    )


def order_of(state: State, before: State) -> ForInstrument:
    """What the instrument is told: a voltage ends a sweep, a sweep that it plays goes on."""
    if state.sweep is None:
        return Drive(state.voltage_V)
    if state.sweep == before.sweep:
        return Look()
    # It reckons with arrays, as no other program of the loop does; ``configure`` has loaded it.
    from pincette.control.planning.swept_voltages import SweptVoltages

    return Wave(SweptVoltages(state.sweep, state.voltage_V), state.sweep.rate_hz)
