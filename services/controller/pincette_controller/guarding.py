"""What ends a segment early: contact, too much force, a lost part, a limit of position.

On its way through free space the arm must meet nothing, from the first sample on. A touch that
the estimator has found stops the motion, and the arm goes back to where it was free.
"""

from math import exp, inf

from msgspec.structs import replace

from pincette.control.force.position_steps import StepLimits
from pincette.control.planning.conditioning import PHASE as CONDITION
from pincette.control.planning.contact_line import ContactLine
from pincette.control.planning.load_line import line_share, stiffest_line, stiffness_bounds
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.quick_grip import LONGEST
from pincette.control.planning.segments import (
    Drive,
    Move,
    PlayedSweep,
    Press,
    Ramp,
    Rest,
    Seek,
)
from pincette.core.faults import KEPT, Outcome, Phase
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.force_bounds import sure_force_mN
from pincette_controller.player_state import (
    NO_PAUSE,
    Player,
    Touch,
    enter,
    follow,
    has_phase,
    jump,
    leave,
    with_line,
    with_slip,
    with_watch,
)
from pincette_controller.slipping import watch_steps
from pincette_controller.taking_over import force_unknown, keep_as_it_is

RETREAT_S = 2.0
"""How long the way back takes where a program has none."""
BACK_UM, BACK_SHARE = 2.0, 0.1
"""Way out of what was met on the way back, in µm, or as a share of the voltage gone back."""
STOP_S = 0.3
"""How long a stop takes to bring x_r to rest."""
FREE = 2.0
"""Stated uncertainties within which the force of an arm that has lost its part lies."""
BEND_FORCES = 5.0
"""Contact forces above which a kink is no bend of the arm itself, however soft it is."""
DRIFT_S = 0.2
"""Over which the force of a free approach is averaged."""
UNGUARDED = (
    Outcome.CONTACT,
    Outcome.SENSOR_JUMP,
    Outcome.POSITION_STEP,
    Outcome.ZERO_REFUSED,
)
"""Outcomes after which a free way is not watched: it leads back, or the force is not known."""
CONFIRMED_PERIODS = 0.5
"""Age, in periods, that a zero which answers the newest request stays below."""
WATCHED = (*KEPT, Phase.SETTLE, Phase.TRACK)
"""Phases in which a part can be lost; in a pause it can be in any."""


def guard(
    program: Program,
    player: Player,
    estimate: ArmEstimate,
    period_s: float,
    limits: StepLimits | None = None,
) -> Player:
    """Judge the newest sample; without ``limits`` no step of the position is looked for."""
    segment = player.segment
    if isinstance(segment, Rest) or player.slip.noise.last_um is not None:
        player = _listen(player, estimate)
    if not segment.guarded and (player.watch.clear or player.watch.touching):
        player = with_watch(player, clear=False, touching=0)
    if segment.open_loop and _beyond(program, estimate.x_um):
        if player.outcome != Outcome.OVERTRAVEL:
            return give_up(program, replace(player, outcome=Outcome.OVERTRAVEL), estimate.x_um)
        return player
    if too_much(program, player, sure_force_mN(estimate)):
        if player.outcome != Outcome.OVERFORCE:
            return give_up(program, replace(player, outcome=Outcome.OVERFORCE), estimate.x_um)
        return player
    if player.watch.zeroing:
        age_s = estimate.zero_age_s
        return await_zero(
            program,
            player,
            estimate.x_um,
            period_s,
            confirmed=age_s is not None and age_s < CONFIRMED_PERIODS * period_s,
            refused=estimate.zero_refusal is not None,
        )
    if player.held and limits is not None:
        watched = watch_steps(program, player, estimate, limits)
        frozen = watched.segment.open_loop and watched.outcome == Outcome.POSITION_STEP
        if watched.slip.suspect is not None:
            return watched
        if watched.slip.confirmed is not player.slip.confirmed and not frozen:
            return watched
        player = watched
    elif player.slip.suspect is not None:
        player = with_slip(player, suspect=None)
    if isinstance(segment, Seek):
        return _seek(program, player, estimate)
    if segment.guarded and player.outcome not in UNGUARDED:
        return _watch_way(program, player, estimate, period_s)
    if segment.phase == Phase.LOAD and not (player.pause.active or player.pause.over):
        player = replace(player, line=_line(program, player, estimate))
        to_mN = segment.to_mN if isinstance(segment, Press) else None
        if program.takes_force_over:
            if force_unknown(player, estimate):
                return keep_as_it_is(player)
            return _follow_line(program, player, period_s, limits)
        rises = (to_mN or 0.0) > player.entry.ref.force_mN
        if rises and not player.outcome and is_uncertain(estimate, to_mN):
            uncertain = with_planned_line(program, player, estimate)
            uncertain = replace(uncertain, outcome=Outcome.UNCERTAIN_FORCE)
            return jump(program, uncertain, Phase.UNLOAD, estimate.x_um)
        if program.contact_line == "planned" or not rises:
            return player
        return _follow_line(program, player, period_s, limits)
    if segment.presses and (segment.phase in WATCHED or player.pause.active):
        return watch_part(program, player, estimate.force_mN, estimate.x_um)
    if player.held and player.segment.open_loop and player.outcome == Outcome.POSITION_STEP:
        return _watch_frozen(program, player, estimate)
    return player


def _listen(player: Player, estimate: ArmEstimate) -> Player:
    """Take the sensor's noise from the samples of a rest without contact."""
    if isinstance(player.segment, Rest):
        return with_slip(player, noise=player.slip.noise.follow(estimate.x_um))
    noise = player.slip.noise.left()
    return with_slip(player, noise=noise, noise_um=noise.noise_um)


def _line(program: Program, player: Player, estimate: ArmEstimate) -> ContactLine:
    """Add a sample to the contact line; after a slip, none of an arm that has lost the part."""
    if player.slip.slips and estimate.force_mN < program.guards.contact_force_mN:
        return ContactLine()
    return player.line.add(estimate.x_um, estimate.force_mN, player.ref.force_mN)


def too_much(program: Program, player: Player, force_mN: float) -> bool:
    """Return whether the force is beyond its limit; within a sweep the force is unknown."""
    if isinstance(player.segment, PlayedSweep):
        return False
    return force_mN > player.began.force_mN + program.guards.force_max_mN


def is_uncertain(estimate: ArmEstimate, load_mN: float | None) -> bool:
    """Return whether U is as large as the force that a load goes to, so that F means nothing."""
    return load_mN is not None and estimate.force_uncertainty_mN >= load_mN


def with_planned_line(program: Program, player: Player, estimate: ArmEstimate) -> Player:
    """Put a line of the planned stiffness through the newest sample, for the way back."""
    planned = program.contact_stiffness_mN_per_um
    return with_line(player, estimate.x_um - estimate.force_mN / planned, planned)


def _beyond(program: Program, x_um: float) -> bool:
    low_um, high_um = program.guards.position_min_um, program.guards.position_max_um
    return (low_um is not None and x_um < low_um) or (high_um is not None and x_um > high_um)


def give_up(program: Program, player: Player, x_um: float) -> Player:
    """Bring each arm back to its rest, by the program's own way back where it has one."""
    for phase in (Phase.RETREAT, Phase.UNLOAD):
        if has_phase(program, phase):
            return jump(program, player, phase, x_um)
    back = Move(Phase.RETREAT, RETREAT_S, to_um=(0.0,) * len(player.applied_V))
    player = replace(player, pause=NO_PAUSE)
    return enter(leave(player, back, x_um), len(program.segments), back)


def await_zero(
    program: Program,
    player: Player,
    x_um: float,
    period_s: float,
    *,
    confirmed: bool,
    refused: bool,
) -> Player:
    """Go on once each estimator has confirmed the zero, or end where it is refused or too late.

    The estimate of the sample after the command with the zero answers it. One that does not has
    missed it: the reading, the voltage or the command was lost. The zero is then requested again,
    in the same rest.
    """
    waited, guards = player.watch.count + 1, program.guards
    if not confirmed and not refused and waited * period_s <= guards.zero_wait_s:
        return replace(with_watch(player, count=waited), zero=True)
    player = with_watch(player, zeroing=False)
    if confirmed or not guards.zero_needed:
        return follow(program, player, x_um)
    return jump(program, replace(player, outcome=Outcome.ZERO_REFUSED), Phase.RETREAT, x_um)


def _seek(program: Program, player: Player, estimate: ArmEstimate) -> Player:
    """Go on to the load after a touch; go back where a hidden force may be as large as that load.

    A part could press with the force of the load where U is as large, before its touch shows. A
    part that pressed when the force was zeroed is met at once, before its planned place: every
    force read by that zero then lacks what it hides.
    """
    guards, following = program.guards, program.segments[player.index + 1]
    load_mN = following.to_mN if isinstance(following, Press) else None
    if is_uncertain(estimate, load_mN):
        uncertain = replace(player, outcome=Outcome.UNCERTAIN_FORCE)
        return jump(program, uncertain, Phase.RETREAT, estimate.x_um)
    if estimate.force_mN < guards.contact_force_mN:
        return with_watch(player, count=0)
    if player.watch.count + 1 < guards.contact_samples:
        return with_watch(player, count=player.watch.count + 1)
    planned = program.contact_stiffness_mN_per_um
    contact_um = estimate.x_um - estimate.force_mN / planned
    if estimate.zero_unconfirmed and contact_um < least_place_um(guards, 0):
        return _turn_back(program, player, estimate, contact_um, estimate.force_mN)
    K_e = planned
    if program.contact_line == "identified":
        _, K_e = stiffness_bounds(planned, program.guards)
    seen = player.ref._replace(x_um=estimate.x_um, force_mN=estimate.force_mN, speed_um_per_s=0.0)
    touched = replace(player, ref=seen, held=True, bump=True)
    touched = with_line(touched, estimate.x_um - estimate.force_mN / K_e, K_e)
    entered = enter(touched, player.index + 1, following)
    if not isinstance(following, Press) or not following.follows:
        return entered
    rate = load_rate(following, estimate.force_mN, planned * player.ref.speed_um_per_s)
    ref = entered.entry.ref._replace(force_rate_mN_per_s=rate)
    return replace(entered, entry=entered.entry._replace(ref=ref))


def least_place_um(guards: Guards, arm: int) -> float:
    """Return the least place of contact that a plan admits for an arm, in µm."""
    return guards.contacts_from_um[arm] if guards.contacts_from_um else -inf


def load_rate(load: Press, force_mN: float, rate_mN_per_s: float) -> float:
    """Return the rate with which the reference of the force begins a load.

    It is the rate of the seek, but not so large that the reference passes the end of the load.
    """
    way_mN, duration_s = (load.to_mN or 0.0) - force_mN, load.move_s or load.duration_s
    if way_mN <= 0.0 or not duration_s:
        return 0.0
    return min(rate_mN_per_s, LONGEST * way_mN / duration_s)


def _follow_line(
    program: Program, player: Player, period_s: float, limits: StepLimits | None
) -> Player:
    """Let the contact line of the references go towards the stiffest one that the load admits.

    K ← K + (1 - e^(-T/τ))·(K_stiffest - K), and x_e likewise. A load that falls keeps the line that
    was fitted over the rise. Whether the part is the planned one
    is judged at the end of the load.
    """
    line = player.entry.line
    if not player.line.count or line is None:
        return player
    x_e_um, K_e = line
    _, hardest = stiffness_bounds(program.contact_stiffness_mN_per_um, program.guards)
    noise_um, s_p = 0.0, inf
    if limits is not None:
        noise_um, s_p = limits.noise_um, limits.compliance_um_per_mN
    towards, share = stiffest_line(player.line, hardest, noise_um, s_p), line_share(period_s)
    return with_line(
        player,
        x_e_um + share * (towards.x_e_um - x_e_um),
        K_e + share * (towards.K_e_mN_per_um - K_e),
    )


def _watch_way(program: Program, player: Player, estimate: ArmEstimate, period_s: float) -> Player:
    """Turn back where the arm meets something; what it still left behind it must clear first.

    A touch is what the estimator has found, or a jump of the force on a quick way to the stand-off.
    """
    guards = program.guards
    quick = any(isinstance(one, Press) and one.follows for one in program.segments)
    if quick and player.segment.phase == Phase.APPROACH and estimate.zero_age_s is not None:
        player, jumped = _watch_jump(program, player, estimate, period_s)
        if jumped:
            return _turn_back(program, player, estimate, estimate.x_um, estimate.force_mN)
    touch_mN = estimate.touch_mN or 0.0
    if player.segment.phase == Phase.RETREAT:
        # Away from the part only what is behind the arm can be met.
        touch_mN = min(touch_mN, 0.0)
    elif player.segment.zeroes or estimate.zero_age_s is None:
        # An arm at rest meets nothing behind it: what pushed it at the zero before is gone. While
        # the force has no zero, no pull is known either.
        touch_mN = max(touch_mN, 0.0)
    bend = is_own_bend(
        guards, player.began.tips_um[0], estimate.x_um, estimate.touch_x_um, touch_mN
    )
    if bend or abs(touch_mN) < guards.contact_force_mN:
        if player.watch.clear and not player.watch.touching:
            return player
        return with_watch(player, clear=True, touching=0)
    if not (player.watch.clear or watches_at_rest(player)):
        return player
    if player.watch.touching + 1 < guards.contact_samples:
        return with_watch(player, touching=player.watch.touching + 1)
    return _turn_back(program, player, estimate, estimate.touch_x_um, touch_mN)


def is_own_bend(
    guards: Guards, began_um: float, x_um: float, touch_x_um: float | None, touch_mN: float
) -> bool:
    """Return whether what looks like a touch is a bend of the free arm, as the guards admit.

    Free arms bend where they come near saturation, and softly. No arm does before the place where
    it began to move.
    """
    if not guards.bend_mN_per_um or touch_x_um is None or touch_x_um <= began_um:
        return False
    softest_mN = guards.bend_mN_per_um * (x_um - touch_x_um)
    return 0.0 < touch_mN < min(softest_mN, BEND_FORCES * guards.contact_force_mN)


def watches_at_rest(player: Player) -> bool:
    """Return whether an arm is watched before its strokes: it need not have been clear before."""
    return player.index == 0 and player.segment.phase == CONDITION


def _watch_jump(
    program: Program, player: Player, estimate: ArmEstimate, period_s: float
) -> tuple[Player, bool]:
    """Whether the force has left its mean over the time before.

    On its first way the free arm's force may be read wrong by more than is stated, but that comes
    little by little; a touch at the speed of an approach is a jump. A part that is met slowly, near
    the end, is found by the zero there.
    """
    guards, jump_mN = program.guards, estimate.force_mN - player.watch.drift_mN
    if jump_mN - estimate.force_uncertainty_mN < guards.contact_force_mN:
        share = 1.0 - exp(-period_s / DRIFT_S)
        return with_watch(player, count=0, drift_mN=player.watch.drift_mN + share * jump_mN), False
    count = player.watch.count + 1
    return with_watch(player, count=count), count >= guards.contact_samples


def _turn_back(
    program: Program,
    player: Player,
    estimate: ArmEstimate,
    touch_x_um: float | None,
    touch_mN: float,
) -> Player:
    """Go back to where the program began, or out of what is in the way on the way back."""
    x_um, behind = estimate.x_um, touch_mN < 0.0
    touched = replace(
        player,
        outcome=Outcome.CONTACT,
        touch=Touch(touch_x_um, touch_mN),
        ref=player.ref._replace(x_um=x_um, speed_um_per_s=0.0),
        bump=True,
        pause=NO_PAUSE,
    )
    if player.segment.open_loop:
        from_V, back_V = estimate.applied_V, min(player.began.voltages_V[0], estimate.applied_V)
        if behind:
            begin_V = player.entry.ref.voltages_V[0]
            back_V = from_V + max(0.0, BACK_SHARE * (begin_V - from_V))
        return enter(touched, -1, Drive(Phase.STOPPING, RETREAT_S, courses=(Ramp(back_V),)))
    if has_phase(program, Phase.RETREAT) and not behind:
        return jump(program, touched, Phase.RETREAT, x_um)
    back_um = x_um + BACK_UM if behind else min(player.began.tips_um[0], x_um)
    rest = Move(Phase.STOPPING, RETREAT_S, player.segment.law, to_um=(back_um,))
    return enter(touched, -1, rest)


def _watch_frozen(program: Program, player: Player, estimate: ArmEstimate) -> Player:
    """End as ``lost`` where the step of a frozen arm has led it to where it would be free.

    A sensor would have to jump by just the force over the compliance to read no force.
    """
    guards = program.guards
    least_mN = min(guards.contact_force_mN, FREE * estimate.force_uncertainty_mN)
    if abs(estimate.force_mN) > least_mN:
        return with_watch(player, count=0) if player.watch.count else player
    if player.watch.count + 1 < guards.lost_samples:
        return with_watch(player, count=player.watch.count + 1)
    return jump(program, replace(player, outcome=Outcome.LOST), Phase.RETREAT, estimate.x_um)


def watch_part(program: Program, player: Player, force_mN: float, x_um: float) -> Player:
    """End as ``lost`` where the least force on the part is far below its reference."""
    guards, count = program.guards, player.watch.count
    # At the trough of a path an error of the estimate must not pass for a loss.
    passing = player.segment.phase != Phase.HOLD or player.index < 0
    light = passing and player.ref.force_mN < 2.0 * guards.contact_force_mN
    if light or force_mN >= guards.lost_fraction * player.ref.force_mN:
        return with_watch(player, count=0) if count else player
    if count + 1 < guards.lost_samples:
        return with_watch(player, count=count + 1)
    lost = replace(player, outcome=Outcome.LOST)
    if program.takes_force_over:
        return give_up(program, lost, x_um)
    return jump(program, lost, Phase.RETREAT, x_um)
