"""Playing a program: which references hold, and what comes after a segment.

Times count in ticks of the controller that could act; a tick without a valid estimate does not
move the program on, and neither does one of a pause. A pause begins at a safe point, a sample at
which the references are at rest: in a rest, between two segments that end at rest, at the turning
point of a path. There the law goes on regulating, and the guards go on watching.
"""

from math import inf

from msgspec.structs import replace

from pincette.control.force.position_steps import StepLimits
from pincette.control.planning import conditioning
from pincette.control.planning.program import Program
from pincette.core.faults import Outcome, Phase
from pincette.core.messages import Estimate
from pincette_controller.guarding import guard
from pincette_controller.player_state import Foreseen, Player, at_tick, follow, jump
from pincette_controller.slipping import admissible, within_plan

MOVING = ("seek", "sweep")
"""Kinds of segment that are nowhere at rest, not even at their end."""


def begin(program: Program, x_um: float, applied_V: float = 0.0, force_mN: float = 0.0) -> Player:
    """Stand at the first segment, with the arm where it is and the force that is read there."""
    first = program.segments[0]
    return Player(
        0,
        first,
        0,
        x_um,
        0.0,
        0.0,
        x_um,
        0.0,
        0.0,
        held=program.begins_held,
        from_V=applied_V,
        voltage_V=applied_V,
        begin_x_um=x_um,
        begin_V=applied_V,
        begin_mN=force_mN if program.begins_held else 0.0,
    )


def advance(
    program: Program,
    player: Player,
    estimate: Estimate,
    period_s: float,
    foreseen: Foreseen | None = None,
    limits: StepLimits | None = None,
) -> Player:
    """Move on by one tick: guards first, then time, then the references of the next sample.

    ``foreseen`` holds where nothing but time has moved the player on. While a step of the position
    waits for its confirmation, references and time rest.
    """
    known = foreseen.player if foreseen is not None and foreseen.of is player else None
    led = player = replace(player, zero=False, bump=False, applied_V=estimate.applied_V)
    if player.ended:
        return player
    player = guard(program, player, estimate, period_s, limits)
    if player.suspect is not None:
        return player
    if player.resumed:
        player = replace(player, resumed=False)
    player = _pause_at_rest(player, period_s)
    while not player.ended and not player.paused and is_over(player, period_s):
        player = _pause_at_rest(_next(program, player, estimate), period_s)
    if player.ended or player.paused:
        return player
    if known is not None and player is led:
        moved = replace(
            player,
            ticks=known.ticks,
            x_r_um=known.x_r_um,
            speed_um_per_s=known.speed_um_per_s,
            force_r_mN=known.force_r_mN,
            voltage_V=known.voltage_V,
        )
        return within_plan(program, moved, estimate.x_um) if moved.held else moved
    moved = at_tick(player, player.ticks + 1, period_s)
    return within_plan(program, moved, estimate.x_um) if moved.held else moved


def foresee(player: Player, period_s: float) -> Foreseen | None:
    """Work out the references of the next sample, if nothing but time moves the player on."""
    if player.ended or player.paused:
        return None
    return Foreseen(player, at_tick(player, player.ticks + 1, period_s))


def _pause_at_rest(player: Player, period_s: float) -> Player:
    """Begin the pause that is requested, where the references are at rest."""
    if not player.pausing or player.ended or not _at_rest(player, period_s):
        return player
    return replace(player, pausing=False, paused=True)


def is_over(player: Player, period_s: float) -> bool:
    """Whether the segment has run its time."""
    segment = player.segment
    if segment.duration_s is None or player.zeroing:
        return False
    return player.ticks * period_s >= segment.duration_s - 0.5 * period_s


def _at_rest(player: Player, period_s: float) -> bool:
    """Whether the references can stay at this sample without a jump of their speed."""
    if player.zeroing or player.segment.kind in MOVING:
        return False
    if is_over(player, period_s):
        return True
    begins_moving = player.from_speed_um_per_s if player.segment.kind == "free" else 0.0
    if player.ticks == 0 and (begins_moving != 0.0 or player.from_rate_mN_per_s != 0.0):
        return False
    before, here, after = (
        (near.x_r_um, near.force_r_mN, near.voltage_V)
        for near in (at_tick(player, player.ticks + step, period_s) for step in (-1, 0, 1))
    )
    # At rest, or where a path turns between one sample and the next.
    return all(
        (now - earlier) * (later - now) <= 0.0
        for earlier, now, later in zip(before, here, after, strict=True)
    )


def _next(program: Program, player: Player, estimate: Estimate) -> Player:
    """Leave a segment that has run its time."""
    segment = player.segment
    if segment.stamps_zero:
        # Stamped with this tick's command; the estimate of the next sample answers it.
        return replace(player, zero=True, zeroing=True, count=0)
    if segment.kind == "seek":
        player = replace(player, outcome=Outcome.NO_CONTACT)
        return jump(program, player, Phase.RETREAT, estimate.x_um)
    if segment.phase == Phase.LOAD and program.contact_line == "identified":
        player = _settle_contact(program, player, estimate)
        if player.outcome:
            return jump(program, player, Phase.UNLOAD, estimate.x_um)
    if not player.outcome:
        player = replace(player, outcome=_outcome(program, player))
    return follow(program, player, estimate.x_um)


def _outcome(program: Program, player: Player) -> Outcome:
    """What has been reached with the end of a segment."""
    segment = player.segment
    if program.begins_held:
        return Outcome.RELEASED if segment.phase == Phase.UNLOAD else Outcome.NONE
    if segment.phase == Phase.HOLD:
        return Outcome.GRIPPED
    if segment.kind == "path":
        return Outcome.TRACKED
    seeks = any(other.kind == "seek" for other in program.segments)
    strokes = segment.phase == conditioning.PHASE
    moves = (segment.open_loop and not strokes) or (segment.guarded and not seeks)
    return Outcome.MOVED if moves else Outcome.NONE


def _settle_contact(program: Program, player: Player, estimate: Estimate) -> Player:
    """Take the contact line as fitted over the load, so that x_r and F_r agree from here on.

    K_e is wrong where it is so for every force within F ± U: K_e errs by the same share. A fit that
    no part can have leaves the planned K_e, through the newest sample, for the way back.
    """
    fit, guards = player.line.fit(), program.guards
    if fit is None or not admissible(program, fit.K_e_mN_per_um):
        planned = program.contact_stiffness_mN_per_um
        return replace(
            player,
            outcome=Outcome.WRONG_STIFFNESS,
            contact_x_um=estimate.x_um - estimate.force_mN / planned,
            K_e_mN_per_um=planned,
        )
    K_e = fit.K_e_mN_per_um
    player = replace(player, contact_x_um=fit.x_e_um, K_e_mN_per_um=K_e)
    F, U = abs(estimate.force_mN), estimate.force_uncertainty_mN
    share = U / F if F > U else 1.0
    softest = guards.stiffness_min_mN_per_um / (1.0 + share)
    hardest = guards.stiffness_max_mN_per_um / (1.0 - share) if share < 1.0 else inf
    if not softest <= K_e <= hardest:
        return replace(player, outcome=Outcome.WRONG_STIFFNESS)
    return player
