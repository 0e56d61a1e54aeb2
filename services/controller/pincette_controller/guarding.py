"""What ends a segment early: contact, too much force, a lost part, a limit of position.

On its way through free space the arm must meet nothing, from the first sample on. A touch that
the estimator has found stops the motion, and the arm goes back to where it was free.
"""

from math import exp, inf

from msgspec.structs import replace

from pincette.control.force.position_steps import StepLimits
from pincette.control.planning.contact_line import ContactLine
from pincette.control.planning.load_line import line_share, stiffest_line, stiffness_bounds
from pincette.control.planning.program import Program, Segment
from pincette.control.planning.quick_grip import LONGEST
from pincette.core.faults import Outcome, Phase
from pincette.core.messages import Estimate
from pincette_controller.player_state import Player, enter, follow, has_phase, jump, leave
from pincette_controller.slipping import watch_steps

RETREAT_S = 2.0
"""How long the way back takes where a program has none."""
BACK_UM, BACK_SHARE = 2.0, 0.1
"""Way out of what was met on the way back, in µm, or as a share of the voltage gone back."""
STOP_S = 0.3
"""How long a stop takes to bring x_r to rest."""
FREE = 2.0
"""Stated uncertainties within which the force of an arm that has lost its part lies."""
DRIFT_S = 0.2
"""Over which the force of a free approach is averaged."""
UNGUARDED = (Outcome.CONTACT, Outcome.SENSOR_JUMP, Outcome.POSITION_STEP)
"""Outcomes after which a free way is not watched: it leads back, or the force is not known."""
WATCHED = (Phase.HOLD, Phase.SETTLE, Phase.TRACK)
"""Phases in which a part can be lost; in a pause it can be in any."""


def guard(
    program: Program,
    player: Player,
    estimate: Estimate,
    period_s: float,
    limits: StepLimits | None = None,
) -> Player:
    """Judge the newest sample; without ``limits`` no step of the position is looked for."""
    segment = player.segment
    if segment.kind == "zero" or player.noise.last_um is not None:
        player = _listen(player, estimate)
    if not segment.guarded and (player.clear or player.touching):
        player = replace(player, clear=False, touching=0)
    if segment.open_loop and _beyond(program, estimate.x_um):
        if player.outcome != Outcome.OVERTRAVEL:
            return _give_up(program, replace(player, outcome=Outcome.OVERTRAVEL), estimate.x_um)
        return player
    if _too_much(program, player, estimate):
        if player.outcome != Outcome.OVERFORCE:
            return _give_up(program, replace(player, outcome=Outcome.OVERFORCE), estimate.x_um)
        return player
    if player.zeroing:
        return _await_zero(program, player, estimate, period_s)
    if player.held and limits is not None:
        watched = watch_steps(program, player, estimate, limits)
        frozen = watched.segment.open_loop and watched.outcome == Outcome.POSITION_STEP
        if watched.suspect is not None:
            return watched
        if watched.seen_step is not player.seen_step and not frozen:
            return watched
        player = watched
    elif player.suspect is not None:
        player = replace(player, suspect=None)
    if segment.kind == "seek":
        return _seek(program, player, estimate)
    if segment.guarded and player.outcome not in UNGUARDED:
        return _watch_way(program, player, estimate, period_s)
    if segment.phase == Phase.LOAD and not (player.paused or player.resumed):
        player = replace(player, line=_line(program, player, estimate))
        rises = (segment.force_to_mN or 0.0) > player.from_force_mN
        if program.contact_line == "planned" or not rises:
            return player
        return _follow_line(program, player, period_s, limits)
    if segment.presses and (segment.phase in WATCHED or player.paused):
        return _watch_part(program, player, estimate)
    if player.held and player.segment.open_loop and player.outcome == Outcome.POSITION_STEP:
        return _watch_frozen(program, player, estimate)
    return player


def _listen(player: Player, estimate: Estimate) -> Player:
    """Take the sensor's noise from the samples of a rest without contact."""
    if player.segment.kind == "zero":
        return replace(player, noise=player.noise.follow(estimate.x_um))
    noise = player.noise.left()
    return replace(player, noise=noise, noise_um=noise.noise_um)


def _line(program: Program, player: Player, estimate: Estimate) -> ContactLine:
    """Add a sample to the contact line; after a slip, none of an arm that has lost the part."""
    if player.slips and estimate.force_mN < program.guards.contact_force_mN:
        return ContactLine()
    return player.line.add(estimate.x_um, estimate.force_mN, player.force_r_mN)


def _too_much(program: Program, player: Player, estimate: Estimate) -> bool:
    """Whether the force is beyond its limit for certain; within a sweep nothing is known of it."""
    if player.segment.kind == "sweep":
        return False
    return sure_force_mN(estimate) - player.begin_mN > program.guards.force_max_mN


def sure_force_mN(estimate: Estimate) -> float:
    """Return F by a zero; before one F - U, the least that presses by the free response."""
    if estimate.zero_age_s is not None:
        return estimate.force_mN
    return estimate.force_mN - estimate.force_uncertainty_mN


def _beyond(program: Program, x_um: float) -> bool:
    low_um, high_um = program.guards.position_min_um, program.guards.position_max_um
    return (low_um is not None and x_um < low_um) or (high_um is not None and x_um > high_um)


def _give_up(program: Program, player: Player, x_um: float) -> Player:
    """Bring the arm back to its rest, by the program's own way back where it has one."""
    for phase in (Phase.RETREAT, Phase.UNLOAD):
        if has_phase(program, phase):
            return jump(program, player, phase, x_um)
    back = Segment(Phase.RETREAT, "free", RETREAT_S, x_to_um=0.0)
    player = replace(player, pausing=False, paused=False)
    return enter(leave(player, back, x_um), len(program.segments), back)


def _await_zero(program: Program, player: Player, estimate: Estimate, period_s: float) -> Player:
    age_s, guards = estimate.zero_age_s, program.guards
    if age_s is not None and age_s < 0.5 * period_s:
        return follow(program, replace(player, zeroing=False), estimate.x_um)
    waited = player.count + 1
    if not estimate.zero_refusal and waited * period_s <= guards.zero_wait_s:
        return replace(player, count=waited)
    player = replace(player, zeroing=False)
    if not guards.zero_needed:
        return follow(program, player, estimate.x_um)
    return jump(
        program, replace(player, outcome=Outcome.ZERO_REFUSED), Phase.RETREAT, estimate.x_um
    )


def _seek(program: Program, player: Player, estimate: Estimate) -> Player:
    guards = program.guards
    if estimate.force_mN < guards.contact_force_mN:
        return replace(player, count=0)
    if player.count + 1 < guards.contact_samples:
        return replace(player, count=player.count + 1)
    planned, following = program.contact_stiffness_mN_per_um, program.segments[player.index + 1]
    K_e = planned
    if program.contact_line == "identified":
        _, K_e = stiffness_bounds(planned, program.guards)
    touched = replace(
        player,
        contact_x_um=estimate.x_um - estimate.force_mN / K_e,
        K_e_mN_per_um=K_e,
        x_r_um=estimate.x_um,
        force_r_mN=estimate.force_mN,
        speed_um_per_s=0.0,
        held=True,
        bump=True,
    )
    entered = enter(touched, player.index + 1, following)
    if not following.follows:
        return entered
    rate = load_rate(following, estimate.force_mN, planned * player.speed_um_per_s)
    return replace(entered, from_rate_mN_per_s=rate)


def load_rate(load: Segment, force_mN: float, rate_mN_per_s: float) -> float:
    """Rate with which F_r begins a load: as it rises, but not so that it passes the load's end."""
    way_mN, duration_s = (load.force_to_mN or 0.0) - force_mN, load.move_s or load.duration_s
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
    x_e_um, K_e = player.contact_x_um, player.K_e_mN_per_um
    if not player.line.count or x_e_um is None or K_e is None:
        return player
    _, hardest = stiffness_bounds(program.contact_stiffness_mN_per_um, program.guards)
    noise_um, s_p = 0.0, inf
    if limits is not None:
        noise_um, s_p = limits.noise_um, limits.compliance_um_per_mN
    towards, share = stiffest_line(player.line, hardest, noise_um, s_p), line_share(period_s)
    return replace(
        player,
        contact_x_um=x_e_um + share * (towards.x_e_um - x_e_um),
        K_e_mN_per_um=K_e + share * (towards.K_e_mN_per_um - K_e),
    )


def _watch_way(program: Program, player: Player, estimate: Estimate, period_s: float) -> Player:
    """Turn back where the arm meets something; what it still left behind it must clear first.

    A touch is what the estimator has found, or a jump of the force on a quick way to the stand-off.
    """
    guards = program.guards
    quick = any(segment.follows for segment in program.segments)
    if quick and player.segment.phase == Phase.APPROACH and estimate.zero_age_s is not None:
        player, jumped = _watch_jump(program, player, estimate, period_s)
        if jumped:
            return _turn_back(program, player, estimate, estimate.x_um, estimate.force_mN)
    touch_mN = estimate.touch_mN or 0.0
    if player.segment.phase == Phase.RETREAT:
        # Away from the part only what is behind the arm can be met.
        touch_mN = min(touch_mN, 0.0)
    if abs(touch_mN) < guards.contact_force_mN:
        if player.clear and not player.touching:
            return player
        return replace(player, clear=True, touching=0)
    if not player.clear:
        return player
    if player.touching + 1 < guards.contact_samples:
        return replace(player, touching=player.touching + 1)
    return _turn_back(program, player, estimate, estimate.touch_x_um, touch_mN)


def _watch_jump(
    program: Program, player: Player, estimate: Estimate, period_s: float
) -> tuple[Player, bool]:
    """Whether the force has left its mean over the time before.

    On its first way the free arm's force may be read wrong by more than is stated, but that comes
    little by little; a touch at the speed of an approach is a jump. A part that is met slowly, near
    the end, is found by the zero there.
    """
    guards, jump_mN = program.guards, estimate.force_mN - player.drift_mN
    if jump_mN - estimate.force_uncertainty_mN < guards.contact_force_mN:
        share = 1.0 - exp(-period_s / DRIFT_S)
        return replace(player, count=0, drift_mN=player.drift_mN + share * jump_mN), False
    return replace(player, count=player.count + 1), player.count + 1 >= guards.contact_samples


def _turn_back(
    program: Program,
    player: Player,
    estimate: Estimate,
    touch_x_um: float | None,
    touch_mN: float,
) -> Player:
    """Go back to where the program began, or out of what is in the way on the way back."""
    x_um, behind = estimate.x_um, touch_mN < 0.0
    touched = replace(
        player,
        outcome=Outcome.CONTACT,
        touch_x_um=touch_x_um,
        touch_mN=touch_mN,
        x_r_um=x_um,
        speed_um_per_s=0.0,
        bump=True,
        pausing=False,
        paused=False,
    )
    if player.segment.open_loop:
        from_V, back_V = estimate.applied_V, min(player.begin_V, estimate.applied_V)
        if behind:
            back_V = from_V + max(0.0, BACK_SHARE * (player.from_V - from_V))
        return enter(
            touched, -1, Segment(Phase.STOPPING, "voltage", RETREAT_S, voltage_to_V=back_V)
        )
    if has_phase(program, Phase.RETREAT) and not behind:
        return jump(program, touched, Phase.RETREAT, x_um)
    back_um = x_um + BACK_UM if behind else min(player.begin_x_um, x_um)
    rest = Segment(Phase.STOPPING, "free", RETREAT_S, x_to_um=back_um, law=player.segment.law)
    return enter(touched, -1, rest)


def _watch_frozen(program: Program, player: Player, estimate: Estimate) -> Player:
    """End as ``lost`` where the step of a frozen arm has led it to where it would be free.

    A sensor would have to jump by just the force over the compliance to read no force.
    """
    guards = program.guards
    least_mN = min(guards.contact_force_mN, FREE * estimate.force_uncertainty_mN)
    if abs(estimate.force_mN) > least_mN:
        return replace(player, count=0) if player.count else player
    if player.count + 1 < guards.lost_samples:
        return replace(player, count=player.count + 1)
    return jump(program, replace(player, outcome=Outcome.LOST), Phase.RETREAT, estimate.x_um)


def _watch_part(program: Program, player: Player, estimate: Estimate) -> Player:
    guards = program.guards
    # At the trough of a path an error of the estimate must not pass for a loss.
    passing = player.segment.phase != Phase.HOLD or player.index < 0
    light = passing and player.force_r_mN < 2.0 * guards.contact_force_mN
    if light or estimate.force_mN >= guards.lost_fraction * player.force_r_mN:
        return replace(player, count=0) if player.count else player
    if player.count + 1 < guards.lost_samples:
        return replace(player, count=player.count + 1)
    return jump(program, replace(player, outcome=Outcome.LOST), Phase.RETREAT, estimate.x_um)
