"""What ends a segment of two arms early: a touch on each side, too much force, a lost part.

A part counts as held from the moment that the sides which are looked for have touched together.
"""

from msgspec.structs import replace

from pincette.control.planning.program import BothArms, Guards, Program, Segment
from pincette.core.faults import Outcome, Phase
from pincette_controller.guarding import BACK_UM, RETREAT_S, WATCHED
from pincette_controller.pair_stand import PairStand, Seen
from pincette_controller.player_state import Player, enter, follow, has_phase, jump, leave

CONFIRMED_PERIODS = 0.5
"""Age, in periods, that a zero which answers the newest request stays below."""


def pair_guard(
    program: Program, player: Player, pair: PairStand, now: Seen, period_s: float
) -> Player:
    """Judge the newest sample, which ``pair`` has followed."""
    segment = player.segment
    if not segment.guarded and (player.clear or player.touching):
        player = replace(player, clear=False, touching=0)
    if segment.open_loop and _beyond(program.guards, now):
        if player.outcome != Outcome.OVERTRAVEL:
            return _give_up(program, replace(player, outcome=Outcome.OVERTRAVEL), now)
    elif (
        max(now.sure_mN) - player.begin_mN > program.guards.force_max_mN and segment.kind != "sweep"
    ):
        if player.outcome != Outcome.OVERFORCE:
            return _give_up(program, replace(player, outcome=Outcome.OVERFORCE), now)
    elif player.zeroing:
        return _await_zeros(program, player, now, period_s)
    elif segment.kind == "seek":
        return _seek(program, player, pair, now)
    elif segment.guarded and player.outcome != Outcome.CONTACT:
        return _watch_way(program, player, pair, now)
    elif segment.presses and (segment.phase in WATCHED or player.paused):
        return _watch_part(program, player, now)
    return player


def _beyond(guards: Guards, now: Seen) -> bool:
    low_um, high_um = guards.position_min_um, guards.position_max_um
    return (low_um is not None and min(now.tips_um) < low_um) or (
        high_um is not None and max(now.tips_um) > high_um
    )


def _give_up(program: Program, player: Player, now: Seen) -> Player:
    """Open both arms together, by the program's own way back where it has one."""
    for phase in (Phase.RETREAT, Phase.UNLOAD):
        if has_phase(program, phase):
            return jump(program, player, phase, now.place_um)
    back = Segment(Phase.RETREAT, "free", RETREAT_S, both=BothArms(0.0, 0.0))
    player = replace(player, pausing=False, paused=False)
    return enter(leave(player, back, now.place_um), len(program.segments), back)


def _await_zeros(program: Program, player: Player, now: Seen, period_s: float) -> Player:
    """Go on once both estimators have answered."""
    guards = program.guards
    newest_s = CONFIRMED_PERIODS * period_s
    if all(age_s is not None and age_s < newest_s for age_s in now.zero_ages_s):
        return follow(program, replace(player, zeroing=False), now.place_um)
    waited = player.count + 1
    if not now.zero_refused and waited * period_s <= guards.zero_wait_s:
        return replace(player, count=waited)
    player = replace(player, zeroing=False)
    if not guards.zero_needed:
        return follow(program, player, now.place_um)
    refused = replace(player, outcome=Outcome.ZERO_REFUSED)
    return jump(program, refused, Phase.RETREAT, now.place_um)


def _seek(program: Program, player: Player, pair: PairStand, now: Seen) -> Player:
    """Go on to the next segment once each side that is looked for has touched."""
    both, guards = player.segment.both, program.guards
    sides = "both" if both is None else both.sides
    # An arm that looks alone shows its touch as a rise above what its model errs by.
    first, second = (mN - drift for mN, drift in zip(pair.felt_mN, pair.drift_mN, strict=True))
    felt = {"first": first, "second": second, "both": min(pair.felt_mN)}[sides]
    if felt < guards.contact_force_mN:
        return player
    first_um, second_um = pair.felt_um
    if sides == "both":
        return _hold(program, player, pair, now)
    pair = replace(
        pair.left(),
        found_first_um=first_um if sides == "first" else pair.found_first_um,
        found_second_um=second_um if sides == "second" else pair.found_second_um,
    )
    # The arm that has found the part stops there; both are led on from where they are.
    touched = replace(player, x_r_um=now.place_um, speed_um_per_s=0.0, pair=pair)
    return enter(touched, player.index + 1, program.segments[player.index + 1])


def _hold(program: Program, player: Player, pair: PairStand, now: Seen) -> Player:
    first_um, second_um = pair.felt_um
    touched = replace(
        player,
        held=True,
        force_r_mN=0.5 * (now.forces_mN[0] + now.forces_mN[1]),
        speed_um_per_s=0.0,
        contact_x_um=player.x_r_um,
        pair=replace(pair, found_first_um=first_um, found_second_um=second_um),
    )
    return enter(touched, player.index + 1, program.segments[player.index + 1])


def _watch_way(program: Program, player: Player, pair: PairStand, now: Seen) -> Player:
    """Turn back where either arm meets something; what it still left behind must be clear first."""
    guards = program.guards
    touches = [mN for _, mN in now.touches]
    if player.segment.phase == Phase.RETREAT:
        # Away from the part only what is behind an arm can be met.
        touches = [min(mN, 0.0) for mN in touches]
    side = 0 if abs(touches[0]) >= abs(touches[1]) else 1
    if abs(touches[side]) < guards.contact_force_mN:
        if player.clear and not player.touching:
            return player
        return replace(player, clear=True, touching=0)
    if not player.clear:
        return player
    if player.touching + 1 < guards.contact_samples:
        return replace(player, touching=player.touching + 1)
    return _turn_back(program, player, pair, now, side)


def _turn_back(program: Program, player: Player, pair: PairStand, now: Seen, side: int) -> Player:
    touch_x_um, touch_mN = now.touches[side]
    behind = touch_mN < 0.0
    touched = replace(
        player,
        outcome=Outcome.CONTACT,
        touch_x_um=touch_x_um,
        touch_mN=touch_mN,
        x_r_um=now.place_um,
        speed_um_per_s=0.0,
        pair=pair.left(),
        pausing=False,
        paused=False,
    )
    if player.segment.open_loop:
        back = Segment(
            Phase.STOPPING,
            "voltage",
            RETREAT_S,
            voltage_to_V=min(player.begin_V, now.applied_V[0]),
            both=BothArms(second_to_V=min(pair.begin_V, now.applied_V[1])),
        )
        return enter(touched, -1, back)
    if has_phase(program, Phase.RETREAT) and not behind:
        return jump(program, touched, Phase.RETREAT, now.place_um)
    tips = now.tips_um
    goals = [min(begin, tip) for begin, tip in zip(pair.begin_um, tips, strict=True)]
    if behind:
        goals = [tip + BACK_UM if arm == side else tip for arm, tip in enumerate(tips)]
    rest = Segment(Phase.STOPPING, "free", RETREAT_S, both=BothArms(goals[0], goals[1]))
    return enter(touched, -1, rest)


def _watch_part(program: Program, player: Player, now: Seen) -> Player:
    """A part is lost where either arm has none of its force: both open, neither lets go alone."""
    guards = program.guards
    passing = player.segment.phase != Phase.HOLD or player.index < 0
    light = passing and player.force_r_mN < 2.0 * guards.contact_force_mN
    if light or min(now.forces_mN) >= guards.lost_fraction * player.force_r_mN:
        return replace(player, count=0) if player.count else player
    if player.count + 1 < guards.lost_samples:
        return replace(player, count=player.count + 1)
    lost = replace(player, outcome=Outcome.LOST)
    return jump(program, lost, Phase.RETREAT, now.place_um)
