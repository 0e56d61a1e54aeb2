"""What ends a segment of two arms early: a touch on each side, too much force, a lost part.

A part counts as held from the moment that the sides which are looked for have touched together.
"""

from msgspec.structs import replace

from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Drive, Move, Ramp, Seek
from pincette.core.faults import Outcome, Phase
from pincette_controller.guarding import (
    BACK_UM,
    CONFIRMED_PERIODS,
    RETREAT_S,
    WATCHED,
    await_zero,
    give_up,
    is_own_bend,
    least_place_um,
    too_much,
    watch_part,
    watches_at_rest,
)
from pincette_controller.pair_stand import PairStand, Seen
from pincette_controller.player_state import (
    NO_PAUSE,
    Player,
    Touch,
    enter,
    has_phase,
    jump,
    opened,
    with_watch,
)


def pair_guard(
    program: Program, player: Player, pair: PairStand, now: Seen, period_s: float
) -> Player:
    """Judge the newest sample, which ``pair`` has followed."""
    segment = player.segment
    if not segment.guarded and (player.watch.clear or player.watch.touching):
        player = with_watch(player, clear=False, touching=0)
    if segment.open_loop and _beyond(program.guards, now):
        if player.outcome != Outcome.OVERTRAVEL:
            return give_up(program, replace(player, outcome=Outcome.OVERTRAVEL), now.place_um)
    elif too_much(program, player, max(now.sure_mN)):
        if player.outcome != Outcome.OVERFORCE:
            return give_up(program, replace(player, outcome=Outcome.OVERFORCE), now.place_um)
    elif player.watch.zeroing:
        newest_s = CONFIRMED_PERIODS * period_s
        return await_zero(
            program,
            player,
            now.place_um,
            period_s,
            confirmed=all(age_s is not None and age_s < newest_s for age_s in now.zero_ages_s),
            refused=now.zero_refused,
        )
    elif isinstance(segment, Seek):
        return _seek(program, player, segment, pair, now)
    elif segment.guarded and player.outcome != Outcome.CONTACT:
        return _watch_way(program, player, now)
    elif segment.presses and (segment.phase in WATCHED or player.pause.active):
        # Both open where either arm has none of its force: neither lets go alone.
        return watch_part(program, player, min(now.forces_mN), now.place_um)
    return player


def _beyond(guards: Guards, now: Seen) -> bool:
    low_um, high_um = guards.position_min_um, guards.position_max_um
    return (low_um is not None and min(now.tips_um) < low_um) or (
        high_um is not None and max(now.tips_um) > high_um
    )


def _seek(program: Program, player: Player, seek: Seek, pair: PairStand, now: Seen) -> Player:
    """Go on to the next segment once each arm that must touch has touched."""
    if all(seek.sides):
        felt_mN = min(pair.felt_mN)
    else:
        # The touch of an arm that moves alone is a rise above the error of its model.
        side = seek.sides.index(True)
        felt_mN = pair.felt_mN[side] - pair.drift_mN[side]
    if felt_mN < program.guards.contact_force_mN:
        return player
    early = _found_early(program, seek, pair, now)
    if early is not None:
        side, place_um = early
        return _turn_back(program, player, now, side, (place_um, pair.felt_mN[side]))
    if all(seek.sides):
        return _hold(program, player, pair, now)
    found = tuple(
        felt_um if touches else before_um
        for touches, felt_um, before_um in zip(
            seek.sides, pair.felt_um, player.entry.found_um, strict=True
        )
    )
    # The arm that has found the part stops there. The references go on from the measured tips.
    touched = replace(
        player,
        ref=opened(player)._replace(x_um=now.place_um, speed_um_per_s=0.0),
        entry=player.entry._replace(found_um=found),
    )
    return enter(touched, player.index + 1, program.segments[player.index + 1])


def _found_early(
    program: Program, seek: Seek, pair: PairStand, now: Seen
) -> tuple[int, float] | None:
    """Return the first arm that met the part before its planned place, and where; None if none did.

    As for one arm: a part that pressed when the force was zeroed is met at once. The faces of both
    sides yield alike, so that a tip is F/(2·K) beyond the place at which it touched.
    """
    for side, touches in enumerate(seek.sides):
        yielded_um = 0.5 * pair.felt_mN[side] / program.contact_stiffness_mN_per_um
        place_um = pair.felt_um[side] - yielded_um
        doubted = touches and now.zeros_unconfirmed[side]
        if doubted and place_um < least_place_um(program.guards, side):
            return side, place_um
    return None


def _hold(program: Program, player: Player, pair: PairStand, now: Seen) -> Player:
    force_mN = 0.5 * (now.forces_mN[0] + now.forces_mN[1])
    touched = replace(
        player,
        held=True,
        ref=player.ref._replace(force_mN=force_mN, speed_um_per_s=0.0),
        entry=player.entry._replace(found_um=pair.felt_um, held_at_um=player.ref.x_um),
    )
    return enter(touched, player.index + 1, program.segments[player.index + 1])


def _watch_way(program: Program, player: Player, now: Seen) -> Player:
    """Turn back where either arm meets something; what it still left behind must be clear first."""
    guards = program.guards
    touches = [mN for _, mN in now.touches]
    if player.segment.phase == Phase.RETREAT:
        # Away from the part only what is behind an arm can be met.
        touches = [min(mN, 0.0) for mN in touches]
    elif player.segment.zeroes:
        # As for one arm: what pushed an arm at the zero before is gone.
        touches = [max(mN, 0.0) for mN in touches]
    else:
        touches = [
            mN if age_s is not None else max(mN, 0.0)
            for mN, age_s in zip(touches, now.zero_ages_s, strict=True)
        ]
    touches = [
        0.0 if is_own_bend(guards, began_um, tip_um, at_um, mN) else mN
        for began_um, tip_um, (at_um, _), mN in zip(
            player.began.tips_um, now.tips_um, now.touches, touches, strict=True
        )
    ]
    side = 0 if abs(touches[0]) >= abs(touches[1]) else 1
    if abs(touches[side]) < guards.contact_force_mN:
        if player.watch.clear and not player.watch.touching:
            return player
        return with_watch(player, clear=True, touching=0)
    if not (player.watch.clear or watches_at_rest(player)):
        return player
    if player.watch.touching + 1 < guards.contact_samples:
        return with_watch(player, touching=player.watch.touching + 1)
    return _turn_back(program, player, now, side, now.touches[side])


def _turn_back(
    program: Program, player: Player, now: Seen, side: int, touch: tuple[float | None, float]
) -> Player:
    """Go back to where the program began, or out of what is behind an arm."""
    touch_x_um, touch_mN = touch
    behind = touch_mN < 0.0
    touched = replace(
        player,
        outcome=Outcome.CONTACT,
        touch=Touch(touch_x_um, touch_mN),
        ref=opened(player)._replace(x_um=now.place_um, speed_um_per_s=0.0),
        pause=NO_PAUSE,
    )
    if player.segment.open_loop:
        ramps = tuple(
            Ramp(min(begin_V, applied_V))
            for begin_V, applied_V in zip(player.began.voltages_V, now.applied_V, strict=True)
        )
        return enter(touched, -1, Drive(Phase.STOPPING, RETREAT_S, courses=ramps))
    if has_phase(program, Phase.RETREAT) and not behind:
        return jump(program, touched, Phase.RETREAT, now.place_um)
    tips = now.tips_um
    goals = [min(begin, tip) for begin, tip in zip(player.began.tips_um, tips, strict=True)]
    if behind:
        goals = [tip + BACK_UM if arm == side else tip for arm, tip in enumerate(tips)]
    return enter(touched, -1, Move(Phase.STOPPING, RETREAT_S, to_um=(goals[0], goals[1])))
