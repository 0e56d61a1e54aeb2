"""Guards that end a segment early: contact, excessive force, a lost part, a position limit.

The guards work for one arm and for two arms. Two guards need a rig with one arm: that for steps of
the position, and that for the contact line of a load.
"""

from math import inf

from msgspec.structs import replace

from pincette.control.force.position_steps import StepLimits
from pincette.control.planning.contact_line import ContactLine
from pincette.control.planning.load_line import (
    line_share,
    line_through_mean,
    stiffest_line,
    stiffness_bounds,
)
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Move, Press, Rest, Seek
from pincette.core.faults import KEPT, FaultCode, Outcome, Phase
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.felt import Arms
from pincette_controller.force_bounds import is_uncertain, sure_force_mN
from pincette_controller.player_state import (
    NO_PAUSE,
    Player,
    enter,
    enter_next,
    has_phase,
    jump,
    leave,
    with_line,
    with_slip,
    with_watch,
)
from pincette_controller.slipping import watch_steps
from pincette_controller.taking_over import force_unknown, keep_as_it_is
from pincette_controller.touching import RETREAT_S, seek, watch_way

STOP_S = 0.3
"""Time within which a stop brings x_r to rest, in s."""
FREE = 2.0
"""Largest force that may remain on an arm that has lost its part, as a multiple of U."""
UNGUARDED = (Outcome.CONTACT, Outcome.SENSOR_JUMP, Outcome.POSITION_STEP)
"""Outcomes after which free motion is not watched, since the arm moves back or its force is
unknown.
"""
CONFIRMED_PERIODS = 0.5
"""Upper bound, in periods, of the age of a zero that confirms the newest request."""
WATCHED = (*KEPT, Phase.SETTLE, Phase.TRACK)
"""Phases in which a part can be lost; during a pause any phase counts."""


def guard(
    program: Program,
    player: Player,
    arms: Arms,
    x_um: float,
    period_s: float,
    limits: StepLimits | None = None,
) -> Player:
    """Judge the newest sample; without ``limits`` steps of the position are not detected.

    ``x_um`` is the position of one arm, or of a part between two arms.
    """
    segment, outcome, alone, first = player.segment, player.outcome, player.felt is None, arms[0]
    if alone and (isinstance(segment, Rest) or player.slip.noise.last_um is not None):
        player = _listen(player, first)
    if not segment.guarded and (player.watch.clear or player.watch.touching):
        player = with_watch(player, clear=False, touching=0)
    if segment.open_loop and _beyond(program.guards, arms):
        if outcome != Outcome.OVERTRAVEL:
            return give_up(program, replace(player, outcome=Outcome.OVERTRAVEL), x_um)
        return player
    if _too_much(program, player, arms):
        if outcome != Outcome.OVERFORCE:
            return give_up(program, replace(player, outcome=Outcome.OVERFORCE), x_um)
        return player
    if player.watch.zeroing:
        return _await_zero(program, player, arms, x_um, period_s)
    if player.held and limits is not None and alone:
        watched = watch_steps(program, player, first, limits)
        frozen = watched.segment.open_loop and watched.outcome == Outcome.POSITION_STEP
        if watched.slip.suspect is not None:
            return watched
        if watched.slip.confirmed is not player.slip.confirmed and not frozen:
            return watched
        player = watched
    elif player.slip.suspect is not None:
        player = with_slip(player, suspect=None)
    if isinstance(segment, Seek):
        return seek(program, player, segment, arms, x_um)
    if segment.guarded and player.outcome not in UNGUARDED:
        return watch_way(program, player, arms, x_um, period_s)
    if segment.phase == Phase.LOAD and not (player.pause.active or player.pause.over):
        if program.takes_force_over and force_unknown(player, arms):
            return keep_as_it_is(player)
        if alone:
            return _watch_load(program, player, first, period_s, limits)
    if segment.presses and (segment.phase in WATCHED or player.pause.active):
        return _watch_part(program, player, arms, x_um)
    if player.held and player.segment.open_loop and player.outcome == Outcome.POSITION_STEP:
        return _watch_frozen(program, player, first)
    return player


def _watch_load(
    program: Program,
    player: Player,
    estimate: ArmEstimate,
    period_s: float,
    limits: StepLimits | None,
) -> Player:
    """Follow the contact line of a load; unload if its force is too uncertain."""
    segment = player.segment
    player = replace(player, line=_line(program, player, estimate))
    to_mN = segment.to_mN if isinstance(segment, Press) else None
    if program.takes_force_over:
        return _follow_line(program, player, period_s, limits)
    rises = (to_mN or 0.0) > player.entry.ref.force_mN
    if rises and not player.outcome and is_uncertain(estimate, to_mN):
        uncertain = with_planned_line(program, player, estimate)
        uncertain = replace(uncertain, outcome=Outcome.UNCERTAIN_FORCE)
        return jump(program, uncertain, Phase.UNLOAD, estimate.x_um)
    if program.contact_line == "planned" or not rises:
        return player
    return _follow_line(program, player, period_s, limits)


def _listen(player: Player, estimate: ArmEstimate) -> Player:
    """Measure the sensor's noise from the samples of a rest without contact."""
    if isinstance(player.segment, Rest):
        return with_slip(player, noise=player.slip.noise.updated(estimate.x_um))
    noise = player.slip.noise.left()
    return with_slip(player, noise=noise, noise_um=noise.noise_um)


def _line(program: Program, player: Player, estimate: ArmEstimate) -> ContactLine:
    """Add a sample to the contact line, unless the arm has lost the part after a slip."""
    if player.slip.slips and estimate.force_mN < program.guards.contact_force_mN:
        return ContactLine()
    return player.line.add(estimate.x_um, estimate.force_mN, player.ref.force_mN)


def _too_much(program: Program, player: Player, arms: Arms) -> bool:
    """Return whether a force exceeds its limit; within a sweep the force is unknown."""
    if player.segment.hides_force:
        return False
    pressed_mN = sure_force_mN(arms[0])
    if player.felt is not None:
        pressed_mN = max(pressed_mN, sure_force_mN(arms[1]))
    return pressed_mN > player.began.force_mN + program.guards.force_max_mN


def with_planned_line(program: Program, player: Player, estimate: ArmEstimate) -> Player:
    """Put a contact line with the planned stiffness through the newest sample, for the motion
    back.
    """
    planned = program.contact_stiffness_mN_per_um
    return with_line(player, estimate.x_um - estimate.force_mN / planned, planned)


def _beyond(guards: Guards, arms: Arms) -> bool:
    low_um, high_um = guards.position_min_um, guards.position_max_um
    for arm in arms:
        low = low_um is not None and arm.x_um < low_um
        if low or (high_um is not None and arm.x_um > high_um):
            return True
    return False


def give_up(program: Program, player: Player, x_um: float) -> Player:
    """Move each arm back to its rest position, by the program's own retreat if it has one."""
    for phase in (Phase.RETREAT, Phase.UNLOAD):
        if has_phase(program, phase):
            return jump(program, player, phase, x_um)
    back = Move(Phase.RETREAT, RETREAT_S, to_um=(0.0,) * len(player.applied_V))
    player = replace(player, pause=NO_PAUSE)
    return enter(leave(player, back, x_um), len(program.segments), back)


def _await_zero(
    program: Program, player: Player, arms: Arms, x_um: float, period_s: float
) -> Player:
    """Continue once the zero of each arm is confirmed; end if a zero is refused or comes too late.

    The estimate of the sample after the command with the zero confirms it. If that estimate does
    not, the reading, the voltage or the command was lost, and the zero is requested again in the
    same rest.
    """
    waited, guards = player.watch.count + 1, program.guards
    confirmed, refused, newest_s = True, False, CONFIRMED_PERIODS * period_s
    for estimate in arms:
        age_s = estimate.zero_age_s
        confirmed = confirmed and age_s is not None and age_s < newest_s
        refusal = estimate.zero_refusal
        # An earlier zero that became invalid does not refuse the new one.
        refused = refused or (refusal is not None and refusal.code != FaultCode.ZERO_INVALID)
    if not confirmed and not refused and waited * period_s <= guards.zero_wait_s:
        return replace(with_watch(player, count=waited), zero=True)
    player = with_watch(player, zeroing=False)
    if confirmed or not guards.zero_needed:
        return enter_next(program, player, x_um)
    return jump(program, replace(player, outcome=Outcome.ZERO_REFUSED), Phase.RETREAT, x_um)


def _follow_line(
    program: Program, player: Player, period_s: float, limits: StepLimits | None
) -> Player:
    """Move the contact line of the references towards the stiffest line that the load admits.

    K ← K + (1 - e^(-T/τ))·(K_stiffest - K), and x_e likewise. A load of a held part begins at a
    high force, at which such a change of x_e and K would move the references by micrometres: its
    line goes through the mean of its samples. While the force of a load falls, the line that was
    fitted during the rise is kept. At the end of the load the fitted stiffness is compared with
    the planned one.
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
    K_e += share * (towards.K_e_mN_per_um - K_e)
    if program.begins_held:
        return with_line(player, *line_through_mean(player.line, K_e))
    return with_line(player, x_e_um + share * (towards.x_e_um - x_e_um), K_e)


def _watch_frozen(program: Program, player: Player, estimate: ArmEstimate) -> Player:
    """End as ``lost`` if a step has moved a frozen arm to the position of a free arm, with F near
    0.

    A sensor error is an unlikely cause: it would have to equal force times compliance.
    """
    guards = program.guards
    own_mN = estimate.force_uncertainty_mN - estimate.force_doubt_mN
    least_mN = min(guards.contact_force_mN, FREE * own_mN)
    if abs(estimate.force_mN) > least_mN:
        return with_watch(player, count=0) if player.watch.count else player
    if player.watch.count + 1 < guards.lost_samples:
        return with_watch(player, count=player.watch.count + 1)
    return jump(program, replace(player, outcome=Outcome.LOST), Phase.RETREAT, estimate.x_um)


def _watch_part(program: Program, player: Player, arms: Arms, x_um: float) -> Player:
    """End as ``lost`` if the smallest force on the part is far below its reference.

    Both arms open if either has no force, so that neither releases the part alone.
    """
    guards, count, force_mN = program.guards, player.watch.count, arms[0].force_mN
    if player.felt is not None:
        force_mN = min(force_mN, arms[1].force_mN)
    # At the minimum of a path an error of the estimate must not be taken for a loss.
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
