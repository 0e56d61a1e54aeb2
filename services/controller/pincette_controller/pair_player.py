"""Playing a program of two arms: as ``player``, with the references of place, opening and force."""

from msgspec.structs import replace

from pincette.control.planning.pair_plan import CARRIED
from pincette.control.planning.program import Program
from pincette.core.faults import Outcome, Phase
from pincette_controller.pair_guarding import pair_guard
from pincette_controller.pair_references import pair_at_tick
from pincette_controller.pair_stand import PairStand, Seen
from pincette_controller.player import MOVING, is_over
from pincette_controller.player_state import Player, follow, jump

MOVE = "move"
"""Phase in which a held part is carried."""


def begin_pair(program: Program, now: Seen) -> Player:
    """Stand at the first segment, with both arms where they are."""
    first, place_um, opening_um = program.segments[0], now.place_um, now.opening_um
    pair = PairStand(
        opening_um,
        begin_um=now.tips_um,
        begin_V=now.applied_V[1],
        tips_um=now.tips_um,
        second_applied_V=now.applied_V[1],
        second_from_V=now.applied_V[1],
        second_voltage_V=now.applied_V[1],
        from_opening_um=opening_um,
    )
    # What is held already is pressed on with as much as is read of it, which may have no zero.
    presses = program.begins_held and first.presses
    force_mN = 0.5 * (now.forces_mN[0] + now.forces_mN[1]) if presses else 0.0
    return Player(
        0,
        first,
        0,
        place_um,
        0.0,
        force_mN,
        place_um,
        0.0,
        force_mN,
        held=program.begins_held,
        applied_V=now.applied_V[0],
        from_V=now.applied_V[0],
        voltage_V=now.applied_V[0],
        begin_x_um=place_um,
        begin_V=now.applied_V[0],
        begin_mN=max(now.forces_mN) if program.begins_held else 0.0,
        contact_x_um=place_um if presses else None,
        ends_after=CARRIED if presses else "",
        pair=pair,
    )


def advance_pair(program: Program, player: Player, now: Seen, period_s: float) -> Player:
    """Move on by one tick: guards first, then time, then the references of the next sample."""
    if player.pair is None:
        raise ValueError("the player has one arm")
    pair = player.pair.follow(now, period_s, 0.5 * program.guards.contact_force_mN)
    player = replace(player, zero=False, bump=False, applied_V=now.applied_V[0], pair=pair)
    if player.ended:
        return player
    player = pair_guard(program, player, pair, now, period_s)
    if player.resumed:
        player = replace(player, resumed=False)
    player = _pause_at_rest(player, period_s)
    while not player.ended and not player.paused and is_over(player, period_s):
        player = _pause_at_rest(_next(program, player, now), period_s)
    if player.ended or player.paused or player.pair is None:
        return player
    return pair_at_tick(player, player.pair, player.ticks + 1, period_s)


def _pause_at_rest(player: Player, period_s: float) -> Player:
    """Begin the pause that is requested, where the place can stay; a force may at any time."""
    if not player.pausing or player.ended or not _at_rest(player, period_s):
        return player
    return replace(player, pausing=False, paused=True)


def _at_rest(player: Player, period_s: float) -> bool:
    if player.zeroing or player.segment.kind in MOVING:
        return False
    if is_over(player, period_s):
        return True
    around = [_led(player, player.ticks + step, period_s) for step in (-1, 0, 1)]
    # At rest, or where a path turns between one sample and the next.
    return all(
        (now - earlier) * (later - now) <= 0.0 for earlier, now, later in zip(*around, strict=True)
    )


def _led(player: Player, ticks: int, period_s: float) -> tuple[float, ...]:
    """What must not jump in its speed, at a tick of the segment."""
    if player.pair is None:
        return ()
    near = pair_at_tick(player, player.pair, ticks, period_s)
    pair = near.pair or player.pair
    return near.x_r_um, pair.opening_um, near.voltage_V, pair.second_voltage_V


def _next(program: Program, player: Player, now: Seen) -> Player:
    """Leave a segment that has run its time."""
    segment = player.segment
    if segment.stamps_zero:
        return replace(player, zero=True, zeroing=True, count=0)
    if segment.kind == "seek":
        nothing = replace(player, outcome=Outcome.NO_CONTACT)
        return jump(program, nothing, Phase.RETREAT, now.place_um)
    if not player.outcome:
        player = replace(player, outcome=_outcome(program, player))
    return follow(program, player, now.place_um)


def _outcome(program: Program, player: Player) -> Outcome:
    """What has been reached with the end of a segment."""
    segment = player.segment
    if program.begins_held:
        if segment.phase == Phase.UNLOAD:
            return Outcome.RELEASED
        return Outcome.MOVED if segment.presses and segment.phase == MOVE else Outcome.NONE
    if segment.phase == Phase.HOLD:
        return Outcome.GRIPPED
    if segment.kind == "path":
        return Outcome.TRACKED
    seeks = any(other.kind == "seek" for other in program.segments)
    moves = segment.open_loop or (segment.guarded and not seeks)
    return Outcome.MOVED if moves else Outcome.NONE
