"""Playing a program: which references hold, and what comes after a segment.

Times count in ticks of the controller that could act; a tick without a valid estimate does not
move the program on, and neither does one of a pause.
"""

from pincette.control.planning.program import Program
from pincette.control.replacing import replace
from pincette.messages import Estimate
from pincette_controller.guarding import guard
from pincette_controller.pausing import is_over, pause_at_rest
from pincette_controller.playing import Player
from pincette_controller.references import refer
from pincette_controller.steering import follow, jump


def begin(program: Program, x_um: float, applied_V: float = 0.0) -> Player:
    """Stand at the first segment, with the arm where it is."""
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
    )


def advance(program: Program, player: Player, estimate: Estimate, period_s: float) -> Player:
    """Move on by one tick: guards first, then time, then the references of the next sample."""
    player = replace(player, zero=False, bump=False, applied_V=estimate.applied_V)
    if player.ended:
        return player
    player = guard(program, player, estimate, period_s)
    if player.resumed:
        player = replace(player, resumed=False)
    player = pause_at_rest(player, period_s)
    while not player.ended and not player.paused and is_over(player, period_s):
        player = pause_at_rest(_next(program, player, estimate), period_s)
    if player.ended or player.paused:
        return player
    ticks = player.ticks + 1
    return player.at(ticks, refer(player, ticks, period_s))


def _next(program: Program, player: Player, estimate: Estimate) -> Player:
    """Leave a segment that has run its time."""
    segment = player.segment
    if segment.stamps_zero:
        # Stamped with this tick's command; the estimate of the next sample answers it.
        return replace(player, zero=True, zeroing=True, count=0)
    if segment.kind == "seek":
        player = replace(player, outcome="no_contact")
        return jump(program, player, "retreat", estimate.x_um)
    if segment.phase == "load" and program.contact_line == "identified":
        player = _settle_contact(program, player)
        if player.outcome:
            return jump(program, player, "unload", estimate.x_um)
    if not player.outcome:
        player = replace(player, outcome=_outcome(program, player))
    return follow(program, player, estimate.x_um)


def _outcome(program: Program, player: Player) -> str:
    """What has been reached with the end of a segment; empty where that is nothing yet."""
    segment = player.segment
    if program.begins_held:
        return "released" if segment.phase == "unload" else ""
    if segment.phase == "hold":
        return "gripped"
    if segment.kind == "path":
        return "tracked"
    return "moved" if segment.open_loop or segment.guarded else ""


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
