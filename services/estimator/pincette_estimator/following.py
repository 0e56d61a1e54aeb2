"""Updates of an arm's memories by the voltage applied."""

from math import hypot

from msgspec.structs import replace

from pincette.control.response.free_response import FreeResponse
from pincette.control.response.residual_table import Residual
from pincette.control.response.voltage_memory import VoltageMemory
from pincette.core.faults import Cause
from pincette.core.messages import Applied
from pincette_estimator.config import ArmConfig
from pincette_estimator.state import ArmState, Ringing

OUTPUT_LOST = (Cause.DEVICE, Cause.SUSPEND)
"""Causes of a trip after which the actuator had to query the output for its voltage."""
UNHEARD_S = 0.5
"""Time without a message of the actuator, in s, after which something else may have changed the
output: shorter than a restart, longer than a gap due to lost messages."""


def _ringing(
    config: ArmConfig, state: ArmState, response: FreeResponse, applied: Applied
) -> Ringing:
    """Add the oscillation that a step of the free position excites to the oscillation of earlier
    steps."""
    shares = config.ring_shares
    if shares.free == 0.0:
        return state.ringing
    step_um = response.position_um() - state.response.position_um()
    return Ringing(hypot(step_um, shares.kept * state.ringing.free_um), applied.part_held)


def unfollowed(config: ArmConfig, state: ArmState, seq: int, applied: Applied | None) -> ArmState:
    """Discard the arm's history after an interval in which its voltage was not known.

    During that interval the voltage may have had any value within the limits. It is assumed that it
    went from that value to the next known voltage without a reversal.
    """
    lost = (seq - state.followed_seq) * config.period_s > UNHEARD_S
    if applied is not None:
        lost = lost or applied.unconfirmed or applied.cause in OUTPUT_LOST
        if state.followed_seq < 0:
            moved_V = abs(applied.arms[config.arm].voltage_V - state.response.voltage_V)
            lost = lost or moved_V > config.unseen_V
    if not lost or state.unknown is config.unknown:
        return state
    return replace(state, unknown=config.unknown, past=VoltageMemory(), highest_V=0.0, known_V=0.0)


def follow_voltage(config: ArmConfig, state: ArmState, applied: Applied) -> ArmState:
    """Update the memories by the voltage applied over all samples since the last known voltage."""
    voltage_V = applied.arms[config.arm].voltage_V
    passed_s = (applied.seq + 1 - state.followed_seq) * config.period_s
    response = state.response.updated(voltage_V, passed_s)
    return replace(
        state,
        missed=_missed(config, state, applied),
        response=response,
        past=state.past.updated(voltage_V, passed_s),
        unknown=state.unknown.updated(voltage_V, passed_s),
        reversal_memory=state.reversal_memory.updated(voltage_V),
        ringing=_ringing(config, state, response, applied),
        followed_seq=applied.seq + 1,
    )


def _missed(config: ArmConfig, state: ArmState, applied: Applied) -> Residual | None:
    """Return the error of x_1 at the tick of this voltage; unchanged if the tick is not known."""
    if config.residual is None or applied.segment is None:
        return state.missed
    return config.residual.at(applied.segment, applied.segment_tick)
