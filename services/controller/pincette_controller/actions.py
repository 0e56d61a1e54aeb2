"""What a person may ask of a program that plays."""

from pincette.control.planning.program import Program, Segment
from pincette.control.replacing import replace
from pincette_controller.guarding import STOP_S
from pincette_controller.playing import Player
from pincette_controller.steering import enter, follow, has, jump


def stop(player: Player) -> Player:
    """Hold a part at the present F_r; without one, bring x_r to rest and end.

    Out of a pause nothing moves, and neither does it where nothing is known of the contact.
    """
    resting, open_loop = player.paused, player.segment.open_loop
    law, speed = player.segment.law, 0.0 if resting else player.speed_um_per_s
    player = replace(
        player,
        outcome="stopped",
        pausing=False,
        paused=False,
        speed_um_per_s=speed,
        ends_after="",
    )
    if player.held:
        if player.contact_x_um is None or (resting and open_loop):
            return enter(player, -1, Segment("hold", "voltage", None))
        force_mN = None if resting else player.force_r_mN
        rest = Segment("hold", "force", None, force_to_mN=force_mN, move_s=STOP_S, law=law)
        return enter(player, -1, rest)
    x_to_um = player.x_r_um + 0.5 * STOP_S * speed
    rest = Segment("stopping", "free", STOP_S, x_to_um=x_to_um, law=law)
    return enter(replace(player, zeroing=False), -1, rest)


def let_go(program: Program, player: Player) -> Player:
    """Stop, with a held part unloaded, where the arm is then."""
    if not player.held:
        return stop(player)
    return release(program, replace(player, outcome="stopped", ends_after="unload"))


def retract(program: Program, player: Player) -> Player:
    """Stop, with a held part unloaded, and go back where the program has a retreat."""
    if player.held:
        return release(program, replace(player, outcome="stopped", ends_after=""))
    if not has(program, "retreat"):
        return stop(player)
    speed = 0.0 if player.paused else player.speed_um_per_s
    player = replace(player, outcome="stopped", zeroing=False, speed_um_per_s=speed)
    return jump(program, player, "retreat", player.x_r_um)


def release(program: Program, player: Player) -> Player:
    """Go on with the unload, from wherever a part is held."""
    return jump(program, player, "unload", player.x_r_um)


def keep(player: Player) -> Player:
    """End with the part held; the voltage stays as it is applied."""
    return replace(player, outcome=player.outcome or "stopped", ended=True, paused=False)


def may_keep(player: Player) -> bool:
    """Whether a part is held, and nothing moves."""
    return player.held and (player.paused or player.segment.phase == "hold")


def proceed(program: Program, player: Player, x_um: float) -> Player:
    """Leave a segment that waits for a person."""
    return follow(program, player, x_um) if waits(player) else player


def waits(player: Player) -> bool:
    """Whether the program waits for the action ``continue``; one that holds waits for another."""
    endless = player.segment.kind == "voltage" and player.segment.duration_s is None
    return endless and not player.held and not player.paused
