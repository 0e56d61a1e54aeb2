"""Pausing a program: where its references rest, and its time stands still.

A safe point is a sample at which the references are at rest: in a rest, between two segments that
end at rest, at the turning point of a path. There the law goes on regulating, and the guards go
on watching.
"""

from pincette.control.replacing import replace
from pincette_controller.playing import Player
from pincette_controller.references import refer

MOVING = ("seek", "sweep")
"""Kinds of segment that are nowhere at rest, not even at their end."""


def pause(player: Player) -> Player:
    """Wish for a pause; one that has begun goes on."""
    return player if player.paused else replace(player, pausing=True)


def resume(player: Player) -> Player:
    """Go on with the segment's time where it stood, or give up the wish."""
    return replace(player, pausing=False, paused=False, resumed=player.paused)


def pause_at_rest(player: Player, period_s: float) -> Player:
    """Begin the pause that is wished for, where the references are at rest."""
    if not player.pausing or player.ended or not at_rest(player, period_s):
        return player
    return replace(player, pausing=False, paused=True)


def is_over(player: Player, period_s: float) -> bool:
    """Whether the segment has run its time."""
    segment = player.segment
    if segment.duration_s is None or player.zeroing:
        return False
    return player.ticks * period_s >= segment.duration_s - 0.5 * period_s


def at_rest(player: Player, period_s: float) -> bool:
    """Whether the references can stay at this sample without a jump of their speed."""
    if player.zeroing or player.segment.kind in MOVING:
        return False
    if is_over(player, period_s):
        return True
    if player.ticks == 0 and player.segment.kind == "free" and player.from_speed_um_per_s != 0.0:
        return False
    before, here, after = (_at(player, player.ticks + step, period_s) for step in (-1, 0, 1))
    # At rest, or where a path turns between one sample and the next.
    return all(
        (now - earlier) * (later - now) <= 0.0
        for earlier, now, later in zip(before, here, after, strict=True)
    )


def _at(player: Player, ticks: int, period_s: float) -> tuple[float, float, float]:
    """References of position, force and voltage at a tick of the segment."""
    found = refer(player, ticks, period_s)
    return found.x_r_um, found.force_r_mN, found.voltage_V
