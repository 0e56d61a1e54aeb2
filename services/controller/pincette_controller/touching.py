"""Contacts of moving arms: with the part that they search for, or with an obstacle.

During a motion through free space, contact is a fault from the first sample on. A contact that the
estimator has found stops the motion, and the arms go back to positions where they were free.

A part between two arms counts as held as soon as the required sides are in contact at the same
time.
"""

from math import exp, inf

from msgspec.structs import replace

from pincette.control.planning.conditioning import PHASE as CONDITION
from pincette.control.planning.contact_line import ContactLine
from pincette.control.planning.load_line import stiffness_bounds
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.quick_grip import LONGEST
from pincette.control.planning.segments import Drive, Move, Press, Ramp, Seek
from pincette.core.faults import Outcome, Phase
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.felt import Arms, Felt
from pincette_controller.force_bounds import is_uncertain
from pincette_controller.player_state import (
    NO_PAUSE,
    Player,
    Touch,
    enter,
    has_phase,
    jump,
    opened,
    with_line,
    with_watch,
)

RETREAT_S = 2.0
"""Duration of the motion back, in s, if a program has no retreat."""
BACK_UM, BACK_SHARE = 2.0, 0.1
"""Motion away from an object behind an arm: distance in µm, or under open loop a fraction of the
voltage since the segment began.
"""
BEND_FORCES = 10.0
"""Multiple of the contact force above which a kink counts as a contact, not as a bend of the arm's
own response, however small the slope of the kink.
"""
DRIFT_S = 0.2
"""Time over which the force of a free approach is averaged, in s."""


def seek(program: Program, player: Player, segment: Seek, arms: Arms, x_um: float) -> Player:
    """Enter the next segment once each arm that searches for the part is in contact with it."""
    if player.felt is None:
        return _seek_by_one(program, player, arms, x_um)
    return _seek_by_two(program, player, segment, player.felt, arms, x_um)


def _seek_by_one(program: Program, player: Player, arms: Arms, x_um: float) -> Player:
    """Enter the load after a contact; go back if a hidden force may be as large as that load.

    If U is as large as the force of the load, a part could press with that force before its contact
    shows. A part that pressed when the force was zeroed makes contact at once, before its planned
    position. Every force read from that zero is then too small by the hidden force.
    """
    guards, following, (estimate,) = program.guards, program.segments[player.index + 1], arms
    load_mN = following.to_mN if isinstance(following, Press) else None
    if is_uncertain(estimate, load_mN):
        uncertain = replace(player, outcome=Outcome.UNCERTAIN_FORCE)
        return jump(program, uncertain, Phase.RETREAT, x_um)
    force_mN = estimate.force_mN
    if force_mN < guards.contact_force_mN:
        return with_watch(player, count=0)
    if player.watch.count + 1 < guards.contact_samples:
        return with_watch(player, count=player.watch.count + 1)
    planned = program.contact_stiffness_mN_per_um
    contact_um = x_um - force_mN / planned
    if estimate.zero_unconfirmed and contact_um < _least_place_um(guards, 0):
        return _turn_back(program, player, arms, x_um, 0, Touch(contact_um, force_mN))
    K_e = planned
    if program.contact_line == "identified":
        _, K_e = stiffness_bounds(planned, program.guards)
    seen = player.ref._replace(x_um=x_um, force_mN=force_mN, speed_um_per_s=0.0)
    touched = replace(player, ref=seen, held=True, bump=True, line=ContactLine())
    touched = with_line(touched, x_um - force_mN / K_e, K_e)
    entered = enter(touched, player.index + 1, following)
    if not isinstance(following, Press) or not following.follows:
        return entered
    rate = load_rate(following, force_mN, planned * player.ref.speed_um_per_s)
    ref = entered.entry.ref._replace(force_rate_mN_per_s=rate)
    return replace(entered, entry=entered.entry._replace(ref=ref))


def _least_place_um(guards: Guards, arm: int) -> float:
    """Return the smallest position of contact that a plan admits for an arm, in µm."""
    return guards.contacts_from_um[arm] if guards.contacts_from_um else -inf


def load_rate(load: Press, force_mN: float, rate_mN_per_s: float) -> float:
    """Return the rate at which the force reference begins a load, in mN/s.

    It corresponds to the speed of the seek, but is limited so that the reference does not pass the
    end of the load.
    """
    way_mN, duration_s = (load.to_mN or 0.0) - force_mN, load.move_s or load.duration_s
    if way_mN <= 0.0 or not duration_s:
        return 0.0
    return min(rate_mN_per_s, LONGEST * way_mN / duration_s)


def _seek_by_two(
    program: Program, player: Player, segment: Seek, felt: Felt, arms: Arms, x_um: float
) -> Player:
    """Enter the next segment once both arms, or the only moving arm, are in contact at the same
    time.
    """
    together = all(segment.sides)
    if together:
        felt_mN = min(felt.mean_mN)
    else:
        # The contact of an arm that moves alone is a rise of its force above the error of its
        # model.
        side = segment.sides.index(True)
        felt_mN = felt.mean_mN[side] - felt.drift_mN[side]
    if felt_mN < program.guards.contact_force_mN:
        return player
    for side, touches in enumerate(segment.sides):
        # As for one arm, a part that pressed when the force was zeroed makes contact at once. The
        # faces of both sides yield equally, so that a tip is F/(2·K) beyond the position of its
        # first contact.
        yielded_um = 0.5 * felt.mean_mN[side] / program.contact_stiffness_mN_per_um
        place_um = felt.mean_um[side] - yielded_um
        doubted = touches and arms[side].zero_unconfirmed
        if doubted and place_um < _least_place_um(program.guards, side):
            touch = Touch(place_um, felt.mean_mN[side])
            return _turn_back(program, player, arms, x_um, side, touch)
    if together:
        ref, held_at_um = player.ref, player.ref.x_um
        ref = ref._replace(force_mN=0.5 * (arms[0].force_mN + arms[1].force_mN))
        found: tuple[float | None, ...] = felt.mean_um
    else:
        # The arm that has found the part stops there. The references continue from the measured
        # tips.
        ref, held_at_um = opened(player)._replace(x_um=x_um), player.entry.held_at_um
        before = player.entry.found_um
        found = tuple(
            felt.mean_um[arm] if one else before[arm] for arm, one in enumerate(segment.sides)
        )
    touched = replace(
        player,
        held=player.held or together,
        ref=ref._replace(speed_um_per_s=0.0),
        entry=player.entry._replace(found_um=found, held_at_um=held_at_um),
    )
    return enter(touched, player.index + 1, program.segments[player.index + 1])


def watch_way(program: Program, player: Player, arms: Arms, x_um: float, period_s: float) -> Player:
    """Turn back if an arm meets an obstacle; the arm must first leave its present contact.

    A contact is reported by the estimator, or is a jump of the force in a fast motion to the
    stand-off. The strongest contact counts. On the way back from a refused zero, an arm whose own
    zero was refused is not watched, since its force is not known.
    """
    guards, segment = program.guards, player.segment
    approaches = segment.phase == Phase.APPROACH and arms[0].zero_age_s is not None
    if approaches and any(isinstance(one, Press) and one.follows for one in program.segments):
        player, jumped = _watch_jump(program, player, arms[0], period_s)
        if jumped:
            return _turn_back(program, player, arms, x_um, 0, Touch(x_um, arms[0].force_mN))
    side, strongest_mN = 0, 0.0
    for arm, estimate in enumerate(arms):
        touch_mN = estimate.touch_mN or 0.0
        if player.outcome == Outcome.ZERO_REFUSED and estimate.zero_refusal is not None:
            continue
        if segment.phase == Phase.RETREAT:
            # During motion away from the part, only an object behind the arm can be met.
            touch_mN = min(touch_mN, 0.0)
        elif segment.zeroes or estimate.zero_age_s is None:
            # A force below 0 is no contact here: an arm at rest cannot meet an object behind it, so
            # the object that pushed it at the previous zero is gone. Without a zero, a force below
            # 0 is not known.
            touch_mN = max(touch_mN, 0.0)
        met = abs(touch_mN) > abs(strongest_mN)
        if met and not _is_own_bend(guards, player.began.tips_um[arm], estimate, touch_mN):
            side, strongest_mN = arm, touch_mN
    if abs(strongest_mN) < guards.contact_force_mN:
        if player.watch.clear and not player.watch.touching:
            return player
        return with_watch(player, clear=True, touching=0)
    if not (player.watch.clear or _watches_at_rest(player)):
        return player
    if player.watch.touching + 1 < guards.contact_samples:
        return with_watch(player, touching=player.watch.touching + 1)
    touch = Touch(arms[side].touch_x_um, strongest_mN)
    return _turn_back(program, player, arms, x_um, side, touch)


def _is_own_bend(guards: Guards, began_um: float, estimate: ArmEstimate, touch_mN: float) -> bool:
    """Return whether an apparent contact is a bend in the free arm's response that the guards
    admit.

    The response of a free arm bends near saturation, with a small slope, and never at positions
    before the one where the motion began.
    """
    touch_x_um = estimate.touch_x_um
    if not guards.bend_mN_per_um or touch_x_um is None or touch_x_um <= began_um:
        return False
    softest_mN = guards.bend_mN_per_um * (estimate.x_um - touch_x_um)
    return 0.0 < touch_mN < min(softest_mN, BEND_FORCES * guards.contact_force_mN)


def _watches_at_rest(player: Player) -> bool:
    """Return whether an arm is watched before its strokes, even if it has not been free before."""
    return player.index == 0 and player.segment.phase == CONDITION


def _watch_jump(
    program: Program, player: Player, estimate: ArmEstimate, period_s: float
) -> tuple[Player, bool]:
    """Return the player, and whether the force has jumped from its earlier mean.

    In the first motion of a free arm the error of the force may be larger than stated, but it grows
    gradually, while a contact at the speed of an approach is a jump. A part that is met slowly,
    near the end of the approach, is found by the zero at that end.
    """
    guards, jump_mN = program.guards, estimate.force_mN - player.watch.drift_mN
    if jump_mN - estimate.force_uncertainty_mN < guards.contact_force_mN:
        share = 1.0 - exp(-period_s / DRIFT_S)
        return with_watch(player, count=0, drift_mN=player.watch.drift_mN + share * jump_mN), False
    count = player.watch.count + 1
    return with_watch(player, count=count), count >= guards.contact_samples


def _turn_back(
    program: Program, player: Player, arms: Arms, x_um: float, side: int, touch: Touch
) -> Player:
    """Go back to where the program began, or away from an object behind an arm.

    The law of one arm is rebased; the law of two arms starts with the present errors.
    """
    behind, began = touch.force_mN < 0.0, player.began
    touched = replace(
        player,
        outcome=Outcome.CONTACT,
        touch=touch,
        ref=opened(player)._replace(x_um=x_um, speed_um_per_s=0.0),
        bump=player.felt is None,
        pause=NO_PAUSE,
    )
    if player.segment.open_loop:
        ramps: list[Ramp] = []
        for arm, estimate in enumerate(arms):
            from_V, back_V = estimate.applied_V, min(began.voltages_V[arm], estimate.applied_V)
            if behind and arm == side:
                begin_V = player.entry.ref.voltages_V[arm]
                back_V = from_V + max(0.0, BACK_SHARE * (begin_V - from_V))
            ramps.append(Ramp(back_V))
        return enter(touched, -1, Drive(Phase.STOPPING, RETREAT_S, courses=tuple(ramps)))
    if has_phase(program, Phase.RETREAT) and not behind:
        return jump(program, touched, Phase.RETREAT, x_um)
    goals: list[float | None] = []
    for arm, estimate in enumerate(arms):
        tip_um = estimate.x_um
        if behind:
            goals.append(tip_um + BACK_UM if arm == side else tip_um)
        else:
            goals.append(min(began.tips_um[arm], tip_um))
    back = Move(Phase.STOPPING, RETREAT_S, player.segment.law, to_um=tuple(goals))
    return enter(touched, -1, back)
