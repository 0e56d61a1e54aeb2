"""Playback of a program: the current references, and the transition after a segment.

Times are counted in ticks in which the controller could act. A tick without a valid estimate does
not advance the program, and neither does a tick of a pause. A pause begins at a safe point, a
sample at which the references are at rest: in a rest, between two segments that end at rest, at the
turning point of a path. During a pause the law and the guards remain active.
"""

from msgspec.structs import replace

from pincette.control.force.freedom import FreeArm, FreedomFit
from pincette.control.force.position_steps import StepLimits
from pincette.control.planning import conditioning
from pincette.control.planning.load_line import (
    LEAST_COUNT,
    STANDARD_ERRORS,
    errors_off,
    line_through_mean,
    stiffness_bounds,
)
from pincette.control.planning.pair_plan import CARRIED
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Entry, LetGo, Move, Reference, Seek, Track
from pincette.core.faults import Outcome, Phase
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.felt import Arms, Felt, place_um
from pincette_controller.force_bounds import is_uncertain
from pincette_controller.guarding import guard, with_planned_line
from pincette_controller.player_state import (
    Began,
    Pause,
    Player,
    enter_next,
    jump,
    with_line,
    with_watch,
)
from pincette_controller.slipping import within_plan
from pincette_controller.taking_over import settle_held, take_over

CARRY = "move"
"""Phase in which two arms carry a held part."""


def begin(program: Program, arms: Arms, period_s: float) -> Player:
    """Return a player at the first segment, with the present positions and forces of the arms."""
    first, held, x_um = program.segments[0], program.begins_held, place_um(arms)
    if program.takes_force_over and len(arms) == 1:
        return take_over(program, arms[0], period_s)
    tips_um = tuple([arm.x_um for arm in arms])
    voltages_V = tuple([arm.applied_V for arm in arms])
    forces_mN = [arm.force_mN for arm in arms]
    # The force of a held part has a zero, so its limit counts from 0.
    unknown = held and not program.takes_force_over
    began = Began(tips_um, voltages_V, max(forces_mN) if unknown else 0.0)
    ref = Reference(x_um, voltages_V=voltages_V)
    if len(arms) == 1:
        return Player(0, first, 0, Entry(ref, period_s), ref, began, voltages_V, held=held)
    # The force reference of a held part begins at the estimated force, which may not have been
    # zeroed.
    presses = held and first.presses
    one_um, two_um = tips_um
    ref = ref._replace(
        force_mN=0.5 * sum(forces_mN) if presses else 0.0, opening_um=one_um + two_um
    )
    return Player(
        0,
        first,
        0,
        Entry(ref, period_s, found_um=(None, None), held_at_um=x_um if presses else None),
        ref,
        began,
        voltages_V,
        held=held,
        ends_after=CARRIED if presses else "",
        felt=Felt((one_um, two_um)),
    )


def advance(
    program: Program,
    player: Player,
    arms: Arms,
    period_s: float,
    limits: StepLimits | None = None,
) -> Player:
    """Advance by one tick: guards first, then time, then the references of the next sample.

    While a step of the position waits for its confirmation, references and time do not advance.
    """
    felt, x_um, applied_V = player.felt, arms[0].x_um, (arms[0].applied_V,)
    if felt is not None:
        felt = felt.updated(arms, period_s, 0.5 * program.guards.contact_force_mN)
        x_um, applied_V = place_um(arms), (arms[0].applied_V, arms[1].applied_V)
    player = replace(player, zero=False, bump=False, applied_V=applied_V, felt=felt)
    if player.ended:
        return player
    if isinstance(player.segment, LetGo) and player.segment.checks and not player.pause.active:
        player = replace(player, freedom=_moved(player, player.segment.checks, arms, period_s))
    player = guard(program, player, arms, x_um, period_s, limits)
    if player.slip.suspect is not None:
        return player
    if player.pause.over:
        player = replace(player, pause=replace(player.pause, over=False))
    player = _pause_at_rest(player, period_s)
    while not player.ended and not player.pause.active and is_over(player, period_s):
        player = _next(program, player, arms, x_um, limits)
        player = _pause_at_rest(player, period_s)
    if player.ended or player.pause.active:
        return player
    ticks, entry = player.ticks + 1, player.entry
    ref = player.segment.reference(ticks * entry.period_s, entry)
    player = replace(player, ticks=ticks, ref=ref)
    return within_plan(program, player, x_um) if player.held and felt is None else player


def _moved(
    player: Player, checks: tuple[FreeArm, ...], arms: Arms, period_s: float
) -> tuple[FreedomFit, ...]:
    """Return the motion of each arm in a check of whether it is free, with the newest sample."""
    fits = player.freedom or (FreedomFit(),) * len(checks)
    return tuple(
        fit.add(check, player.ticks * period_s, arm.x_um, arm.force_mN)
        for fit, check, arm in zip(fits, checks, arms, strict=True)
    )


def _is_free(player: Player, checks: tuple[FreeArm, ...]) -> bool:
    """Return whether the check that has just ended found each arm free."""
    for fit, check in zip(player.freedom, checks, strict=True):
        found = fit.freedom(check, drifts=True)
        if found is None or found.verdict(check) != "released":
            return False
    return True


def _pause_at_rest(player: Player, period_s: float) -> Player:
    """Begin a requested pause if the references are at rest."""
    if not player.pause.requested or player.ended or not _at_rest(player, period_s):
        return player
    return replace(player, pause=Pause(active=True))


def is_over(player: Player, period_s: float) -> bool:
    """Return whether the duration of the segment has passed."""
    segment = player.segment
    if segment.duration_s is None or player.watch.zeroing:
        return False
    return player.ticks * period_s >= segment.duration_s - 0.5 * period_s


def _at_rest(player: Player, period_s: float) -> bool:
    """Return whether the references can rest at this sample without a jump of their speed."""
    segment, entry = player.segment, player.entry
    if player.watch.zeroing or segment.ends_moving:
        return False
    if is_over(player, period_s):
        return True
    alone = player.felt is None
    if alone and player.ticks == 0:
        begins_moving = isinstance(segment, Move) and entry.ref.speed_um_per_s != 0.0
        if begins_moving or entry.ref.force_rate_mN_per_s != 0.0:
            return False
    # A force between two arms may rest at any time.
    before, here, after = (
        (near.x_um, near.force_mN if alone else near.opening_um, *near.voltages_V)
        for near in (
            segment.reference((player.ticks + step) * period_s, entry) for step in (-1, 0, 1)
        )
    )
    # At rest, or where a path turns between one sample and the next.
    return all(
        (now - earlier) * (later - now) <= 0.0
        for earlier, now, later in zip(before, here, after, strict=True)
    )


def _next(
    program: Program, player: Player, arms: Arms, x_um: float, limits: StepLimits | None
) -> Player:
    """Leave a segment whose duration has passed."""
    segment = player.segment
    if segment.zeroes:
        # The command of this tick requests the zero; the estimate of the next sample confirms it.
        return replace(with_watch(player, zeroing=True, count=0), zero=True)
    if isinstance(segment, Seek):
        player = replace(player, outcome=Outcome.NO_CONTACT)
        return jump(program, player, Phase.RETREAT, x_um)
    settles = segment.phase == Phase.LOAD and program.contact_line == "identified"
    if settles and program.begins_held:
        player = settle_held(program, player)
    elif settles and player.felt is None:
        player = _settle_contact(program, player, arms[0], limits)
        if player.outcome:
            return jump(program, player, Phase.UNLOAD, x_um)
    if not player.outcome:
        player = replace(player, outcome=_outcome(program, player))
    if isinstance(segment, LetGo) and segment.checks and _is_free(player, segment.checks):
        return replace(player, ended=True, held=False)
    return enter_next(program, player, x_um)


def _outcome(program: Program, player: Player) -> Outcome:
    """Return the outcome reached at the end of a segment."""
    segment = player.segment
    if program.begins_held:
        if segment.phase == Phase.UNLOAD:
            return Outcome.RELEASED
        return Outcome.MOVED if segment.presses and segment.phase == CARRY else Outcome.NONE
    if segment.phase == Phase.HOLD:
        return Outcome.GRIPPED
    if isinstance(segment, Track):
        return Outcome.TRACKED
    seeks = any(isinstance(other, Seek) for other in program.segments)
    strokes = segment.phase == conditioning.PHASE
    moves = (segment.open_loop and not strokes) or (segment.guarded and not seeks)
    return Outcome.MOVED if moves else Outcome.NONE


def _settle_contact(
    program: Program, player: Player, estimate: ArmEstimate, limits: StepLimits | None
) -> Player:
    """Adopt the contact line fitted over the load, so that x_r and F_r are consistent from here on.

    K_e is judged wrong only if it is inadmissible for every force within F ± U, since K_e and F
    have the same relative error, and if noise does not explain the deviation: over the short load
    of a small force, the fit of a noisy sensor scatters by more than the tolerance of the part. If
    noise explains the deviation, the line gets the nearest permitted stiffness.

    After a stiffness that no part can have, the motion back uses the planned K_e, with a line
    through the newest sample. The same holds for a load whose highest force is not above U, where
    the fit is meaningless.
    """
    fit, guards = player.line.fit(), program.guards
    highest_mN = max(abs(estimate.force_mN), player.entry.ref.force_mN)
    if is_uncertain(estimate, highest_mN):
        player = replace(player, outcome=Outcome.UNCERTAIN_FORCE)
        return with_planned_line(program, player, estimate)
    F, U = abs(estimate.force_mN), estimate.force_uncertainty_mN
    share = U / F if F > U else 1.0
    least, most = stiffness_bounds(program.contact_stiffness_mN_per_um, guards)
    softest = max(least, guards.stiffness_min_mN_per_um / (1.0 + share))
    hardest = most if share == 1.0 else min(most, guards.stiffness_max_mN_per_um / (1.0 - share))
    if fit is not None and softest <= fit.K_e_mN_per_um <= hardest:
        return with_line(player, fit.x_e_um, fit.K_e_mN_per_um)
    if limits is not None and player.line.count >= LEAST_COUNT:
        noise_um = limits.with_noise(player.slip.noise_um).noise_um
        s_p, load = limits.compliance_um_per_mN, player.line
        off, nearest = min((errors_off(load, K, noise_um, s_p), K) for K in (softest, hardest))
        if off <= STANDARD_ERRORS:
            return with_line(player, *line_through_mean(load, nearest))
    player = replace(player, outcome=Outcome.WRONG_STIFFNESS)
    if fit is None or not least <= fit.K_e_mN_per_um <= most:
        return with_planned_line(program, player, estimate)
    return with_line(player, fit.x_e_um, fit.K_e_mN_per_um)
