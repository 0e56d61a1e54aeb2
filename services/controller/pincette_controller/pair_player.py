"""Playing a program of two arms: as ``player``, with the references of place, opening and force."""

from msgspec.structs import replace

from pincette.control.planning.pair_plan import CARRIED
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Entry, Reference
from pincette_controller.pair_guarding import pair_guard
from pincette_controller.pair_stand import PairStand, Seen
from pincette_controller.player import move_on
from pincette_controller.player_state import Began, Player, at_tick


def begin_pair(program: Program, now: Seen, period_s: float) -> Player:
    """Stand at the first segment, with both arms where they are."""
    first, place_um, opening_um = program.segments[0], now.place_um, now.opening_um
    # What is held already is pressed on with as much as is read of it, which may have no zero.
    presses = program.begins_held and first.presses
    force_mN = 0.5 * (now.forces_mN[0] + now.forces_mN[1]) if presses else 0.0
    ref = Reference(place_um, force_mN=force_mN, voltages_V=now.applied_V, opening_um=opening_um)
    held_at_um = place_um if presses else None
    entry = Entry(ref, period_s, found_um=(None, None), held_at_um=held_at_um)
    return Player(
        0,
        first,
        0,
        entry,
        ref,
        Began(now.tips_um, now.applied_V, max(now.forces_mN) if program.begins_held else 0.0),
        now.applied_V,
        held=program.begins_held,
        ends_after=CARRIED if presses else "",
        pair=PairStand(tips_um=now.tips_um),
    )


def advance_pair(program: Program, player: Player, now: Seen, period_s: float) -> Player:
    """Move on by one tick: guards first, then time, then the references of the next sample."""
    if player.pair is None:
        raise ValueError("the player has one arm")
    pair = player.pair.follow(now, period_s, 0.5 * program.guards.contact_force_mN)
    player = replace(player, zero=False, bump=False, applied_V=now.applied_V, pair=pair)
    if player.ended:
        return player
    player = move_on(
        program, pair_guard(program, player, pair, now, period_s), now.place_um, period_s
    )
    if player.ended or player.pause.active:
        return player
    return at_tick(player, player.ticks + 1)
