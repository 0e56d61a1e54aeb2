"""Playing a program: which references hold, and which guard ends a segment.

Times count in ticks of the controller that could act; a tick without a valid estimate does not
move the program on.
"""

from dataclasses import replace

from pincette.control.planning.program import Program, Segment
from pincette.messages import Estimate
from pincette_controller.playing import Player
from pincette_controller.references import refer

STOP_S = 0.3
"""How long a stop takes to bring x_r to rest."""
RETREAT_S = 2.0
"""How long the way back takes where a program has none."""
WATCHED = ("hold", "settle", "track")
"""Phases in which a part can be lost."""


def begin(program: Program, x_um: float, applied_V: float = 0.0) -> Player:
    """Stand at the first segment, with the arm where it is."""
    first = program.segments[0]
    return Player(
        0, first, 0, x_um, 0.0, 0.0, x_um, 0.0, 0.0, from_V=applied_V, voltage_V=applied_V
    )


def advance(program: Program, player: Player, estimate: Estimate, period_s: float) -> Player:
    """Move on by one tick: guards first, then time, then the references of the next sample."""
    player = replace(player, zero=False, bump=False, applied_V=estimate.applied_V)
    player = _guard(program, player, estimate, period_s)
    while not player.ended and _is_over(player, period_s):
        player = _next(program, player, estimate)
    if player.ended:
        return player
    return refer(replace(player, ticks=player.ticks + 1), period_s)


def stop(player: Player) -> Player:
    """Hold a part at the present F_r; without one, bring x_r to rest and end."""
    law = player.segment.law
    if player.held:
        rest = Segment("hold", "force", None, force_to_mN=player.force_r_mN, move_s=STOP_S, law=law)
        return _enter(replace(player, outcome="stopped"), -1, rest)
    x_to_um = player.x_r_um + 0.5 * STOP_S * player.speed_um_per_s
    rest = Segment("stopping", "free", STOP_S, x_to_um=x_to_um, law=law)
    return _enter(replace(player, outcome="stopped", zeroing=False), -1, rest)


def release(program: Program, player: Player) -> Player:
    """Go on with the unload, from wherever a part is held."""
    return _jump(program, player, "unload", player.x_r_um)


def proceed(program: Program, player: Player, x_um: float) -> Player:
    """Leave a segment that waits for a person."""
    return _follow(program, player, x_um) if waits(player) else player


def waits(player: Player) -> bool:
    """Whether the program waits for the action ``continue``."""
    return player.segment.kind == "voltage" and player.segment.duration_s is None


def _guard(program: Program, player: Player, estimate: Estimate, period_s: float) -> Player:
    guards, segment = program.guards, player.segment
    F_mN = estimate.force_mN
    if segment.open_loop and _beyond(program, estimate.x_um):
        return _give_up(program, replace(player, outcome="overtravel"), estimate.x_um)
    if estimate.zero_age_s is not None and F_mN > guards.force_max_mN:
        if player.outcome != "overforce":
            player = replace(player, outcome="overforce")
            return _jump(program, player, "retreat", estimate.x_um)
    elif segment.kind == "zero" and player.zeroing:
        return _await_zero(program, player, estimate, period_s)
    elif segment.kind == "seek":
        return _seek(program, player, estimate)
    elif segment.phase == "load":
        line = player.line.add(estimate.x_um, F_mN, player.force_r_mN)
        return replace(player, line=line)
    elif segment.presses and segment.phase in WATCHED:
        return _watch_part(program, player, estimate)
    return player


def _beyond(program: Program, x_um: float) -> bool:
    low_um, high_um = program.guards.position_min_um, program.guards.position_max_um
    return (low_um is not None and x_um < low_um) or (high_um is not None and x_um > high_um)


def _give_up(program: Program, player: Player, x_um: float) -> Player:
    """Bring the arm back to its rest, by the program's own retreat where it has one."""
    if any(segment.phase == "retreat" for segment in program.segments):
        return _jump(program, player, "retreat", x_um)
    back = Segment("retreat", "free", RETREAT_S, x_to_um=0.0)
    return _enter(_let_go(player, back, x_um), len(program.segments), back)


def _await_zero(program: Program, player: Player, estimate: Estimate, period_s: float) -> Player:
    age_s = estimate.zero_age_s
    if age_s is not None and age_s < 0.5 * period_s:
        return _follow(program, replace(player, zeroing=False), estimate.x_um)
    waited = player.count + 1
    if estimate.zero_refusal or waited * period_s > program.guards.zero_wait_s:
        player = replace(player, outcome="zero_refused", zeroing=False)
        return _jump(program, player, "retreat", estimate.x_um)
    return replace(player, count=waited)


def _seek(program: Program, player: Player, estimate: Estimate) -> Player:
    guards = program.guards
    if estimate.force_mN < guards.contact_force_mN:
        return replace(player, count=0)
    if player.count + 1 < guards.contact_samples:
        return replace(player, count=player.count + 1)
    K_e = program.contact_stiffness_mN_per_um
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
    return _enter(touched, player.index + 1, program.segments[player.index + 1])


def _watch_part(program: Program, player: Player, estimate: Estimate) -> Player:
    guards = program.guards
    # At the trough of a path an error of the estimate must not pass for a loss.
    passing = player.segment.phase != "hold" or player.index < 0
    light = passing and player.force_r_mN < 2.0 * guards.contact_force_mN
    if light or estimate.force_mN >= guards.lost_fraction * player.force_r_mN:
        return replace(player, count=0) if player.count else player
    if player.count + 1 < guards.lost_samples:
        return replace(player, count=player.count + 1)
    return _jump(program, replace(player, outcome="lost"), "retreat", estimate.x_um)


def _is_over(player: Player, period_s: float) -> bool:
    segment = player.segment
    if segment.duration_s is None or player.zeroing:
        return False
    return player.ticks * period_s >= segment.duration_s - 0.5 * period_s


def _next(program: Program, player: Player, estimate: Estimate) -> Player:
    """Leave a segment that has run its time."""
    segment = player.segment
    if segment.kind == "zero":
        # Stamped with this tick's command; the estimate of the next sample answers it.
        return replace(player, zero=True, zeroing=True, count=0)
    if segment.kind == "seek":
        player = replace(player, outcome="no_contact")
        return _jump(program, player, "retreat", estimate.x_um)
    if segment.phase == "load" and program.contact_line == "identified":
        player = _settle_contact(program, player)
        if player.outcome:
            return _jump(program, player, "unload", estimate.x_um)
    if segment.phase == "hold" and not player.outcome:
        player = replace(player, outcome="gripped")
    if segment.kind == "path" and not player.outcome:
        player = replace(player, outcome="tracked")
    if segment.open_loop and not player.outcome:
        player = replace(player, outcome="moved")
    return _follow(program, player, estimate.x_um)


def _follow(program: Program, player: Player, x_um: float) -> Player:
    """Enter the segment after this one, or end."""
    index = player.index + 1
    if player.segment.phase == "stopping" or index >= len(program.segments):
        return replace(player, ended=True)
    return _enter(_let_go(player, program.segments[index], x_um), index, program.segments[index])


def _let_go(player: Player, following: Segment, x_um: float) -> Player:
    """Where the pressing ends, the law is fed no force any more and x_r starts from x.

    Without a law a part that is pressed stays held.
    """
    if following.open_loop:
        return player
    if player.segment.open_loop:
        held = player.held and following.presses
        force_mN = player.force_r_mN if held else 0.0
        return replace(player, held=held, bump=True, x_r_um=x_um, force_r_mN=force_mN)
    if not player.pressing or following.presses:
        return player
    return replace(player, held=False, bump=True, x_r_um=x_um, force_r_mN=0.0)


def _settle_contact(program: Program, player: Player) -> Player:
    """Take the contact line as fitted over the load, so that x_r and F_r agree from here on."""
    fit = player.line.fit()
    guards = program.guards
    if fit is None:
        return replace(player, outcome="wrong_stiffness")
    K_e = fit.K_e_mN_per_um
    player = replace(player, contact_x_um=fit.x_e_um, K_e_mN_per_um=K_e)
    if not guards.stiffness_min_mN_per_um <= K_e <= guards.stiffness_max_mN_per_um:
        return replace(player, outcome="wrong_stiffness")
    return player


def _jump(program: Program, player: Player, phase: str, x_um: float) -> Player:
    """Go to the first segment of a phase; a program without it ends."""
    for index, segment in enumerate(program.segments):
        if segment.phase == phase:
            return _enter(_let_go(player, segment, x_um), index, segment)
    return replace(player, ended=True)


def _enter(player: Player, index: int, segment: Segment) -> Player:
    return replace(
        player,
        index=index,
        segment=segment,
        ticks=0,
        count=0,
        from_x_um=player.x_r_um,
        from_speed_um_per_s=player.speed_um_per_s,
        from_force_mN=player.force_r_mN,
        from_V=player.applied_V,
        voltage_V=player.applied_V,
    )
