"""From one segment of a program to another."""

from pincette.control.planning.program import Program, Segment
from pincette.control.replacing import replace
from pincette_controller.playing import Player


def enter(player: Player, index: int, segment: Segment) -> Player:
    """Stand at the begin of a segment, with references and voltage as they are."""
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


def follow(program: Program, player: Player, x_um: float) -> Player:
    """Enter the segment after this one, or end."""
    index, segment = player.index + 1, player.segment
    early = segment.phase == player.ends_after and not segment.open_loop
    if segment.phase == "stopping" or early or index >= len(program.segments):
        return replace(player, ended=True, held=player.held and segment.phase != "unload")
    return enter(let_go(player, program.segments[index], x_um), index, program.segments[index])


def jump(program: Program, player: Player, phase: str, x_um: float) -> Player:
    """Go to the first segment of a phase, paused or not; a program without it ends."""
    player = replace(player, pausing=False, paused=False)
    for index, segment in enumerate(program.segments):
        if segment.phase == phase:
            return enter(let_go(player, segment, x_um), index, segment)
    return replace(player, ended=True)


def has(program: Program, phase: str) -> bool:
    """Whether a program has a phase."""
    return any(segment.phase == phase for segment in program.segments)


def let_go(player: Player, following: Segment, x_um: float) -> Player:
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
