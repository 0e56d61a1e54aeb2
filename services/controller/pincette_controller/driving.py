"""Compute voltages from a player's references, by the law of its segment or without one."""

from typing import Any

from msgspec.structs import replace

from pincette.control.planning.segments import Press, Seek
from pincette.control.response.identified_response import IdentifiedResponse
from pincette.control.safety.voltage import SLEW_DOWN, SLEW_UP, VOLTAGE_MAX, VOLTAGE_MIN
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.arm_memory import ArmMemory
from pincette_controller.control_laws import ArmView, ControlLaw, Handover, Setpoint, Wanted
from pincette_controller.felt import Arms
from pincette_controller.player_state import Player

RAISING, LOWERING = VOLTAGE_MAX | SLEW_UP, VOLTAGE_MIN | SLEW_DOWN
"""Bits of ``limits_active`` that prevent a rise or a fall of the voltage."""


def arm_view(estimate: ArmEstimate, memory: ArmMemory) -> ArmView:
    """Return the view of one arm that a law uses."""
    bits, limited, response = estimate.limits_active, 0, memory.response
    if bits:
        limited = 1 if bits & RAISING else -1 if bits & LOWERING else 0
    known = response.memory if isinstance(response, IdentifiedResponse) else None
    return ArmView(estimate.x_um, estimate.force_mN, estimate.applied_V, limited, response, known)


def at_measured(player: Player, arms: Arms, x_um: float) -> Player:
    """Return the player with references at the measured position, as in a segment without a law."""
    force_mN, opening_um = arms[0].force_mN, 0.0
    if player.felt is not None:
        force_mN = 0.5 * (force_mN + arms[1].force_mN)
        opening_um = sum(player.felt.tips_um)
    ref = player.ref._replace(
        x_um=x_um,
        speed_um_per_s=0.0,
        force_mN=force_mN if player.held else 0.0,
        opening_um=opening_um,
    )
    return replace(player, ref=ref)


def drive(
    laws: tuple[ControlLaw, ...],
    state: Any,
    before: Player,
    player: Player,
    arms: tuple[ArmView, ...],
    correction_um: float = 0.0,
) -> tuple[Any, Wanted]:
    """Return the next state of the law and the voltages of the coming sample.

    Parameters
    ----------
    state
        State of the law of ``before``; None before the first step of any law.
    before
        Player that set the references of the newest sample.
    player
        Player that sets the references of the coming sample.
    correction_um
        Learned correction of x_r.
    """
    law, law_before = laws[player.segment.law], laws[before.segment.law]
    if state is None:
        state = law_before.start(arms)
        if before.segment.presses:
            # The force of a part that is held already does not change suddenly.
            taken = Handover(before.ref, pressed=True, restarted=True, before=law_before)
            state = law_before.rebase(state, arms, taken)
    handover = _handover(before, player, law_before)
    if handover is not None:
        state = law.rebase(state, arms, handover)
    after, wanted = law.step(state, arms, _setpoint(player, correction_um))
    if player.segment.open_loop:
        wanted = replace(wanted, voltages_V=player.ref.voltages_V)
    return after, wanted


def _handover(before: Player, player: Player, law_before: ControlLaw) -> Handover | None:
    """Return how the law must be rebased before this step; None if it continues."""
    segment = player.segment
    restarts = player.bump or segment.open_loop
    if restarts or player.segment.presses != before.segment.presses:
        ref = player.ref
        if player.bump and isinstance(segment, Press) and segment.follows:
            # These references begin in motion, at the newest sample, which shows the contact.
            ref = player.entry.ref
        return Handover(ref, player.segment.presses, restarts, law_before)
    if segment.law != before.segment.law:
        # Only the law changes; the newest sample belongs to the references of the tick before.
        return Handover(before.ref, player.segment.presses, restarts, law_before)
    return None


def _setpoint(player: Player, correction_um: float) -> Setpoint:
    """Return the goal of the law.

    In a pause, at the end and in open loop the rates of its references are 0.
    """
    ref, segment, pressed = player.ref, player.segment, player.segment.presses
    rests = player.pause.active or player.ended
    if rests or segment.open_loop:
        ref = ref._replace(
            speed_um_per_s=0.0,
            acceleration_um_per_s2=0.0,
            force_rate_mN_per_s=0.0,
            opening_speed_um_per_s=0.0,
        )
    return Setpoint(
        ref,
        pressed,
        segment.open_loop,
        seeks=isinstance(segment, Seek) and not rests,
        line=player.entry.line if pressed else None,
        correction_um=correction_um,
    )
