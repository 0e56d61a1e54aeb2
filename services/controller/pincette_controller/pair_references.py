"""References of two arms at a tick: place, opening and force, each from rest to rest or on a path.

Tips go along quintics of one duration, hence place and opening do too.
"""

from msgspec.structs import replace

from pincette.control.laws.two_arms import TwoArmReferences
from pincette.control.planning.paths import Path
from pincette.control.planning.profiles import Quintic, move, quintic, run_up
from pincette_controller.pair_stand import PairStand
from pincette_controller.player_state import Player

BRAKE_UM = 2.0
"""Way on which a place that is led on no further comes to rest, at most."""


def pair_at_tick(player: Player, pair: PairStand, ticks: int, period_s: float) -> Player:
    """The player at ``ticks`` of its segment, with the references of the sample that follows."""
    segment, t_s = player.segment, ticks * period_s
    player = replace(player, ticks=ticks)
    if segment.kind == "free":
        return _led(player, pair, t_s)
    if segment.kind == "seek" and segment.duration_s:
        return _sought(player, pair, t_s, segment.duration_s)
    if segment.kind == "force":
        return _pressed(player, pair, t_s)
    if segment.kind == "path":
        return _tracked(player, pair, t_s)
    if segment.kind == "voltage":
        return _driven(player, pair, ticks, t_s)
    return _resting(player, pair)


def references(player: Player, pair: PairStand) -> TwoArmReferences:
    """What the law is told of the coming sample; in a pause all of it rests."""
    rests = player.paused or player.ended
    return TwoArmReferences(
        place_um=player.x_r_um,
        force_mN=player.force_r_mN,
        opening_um=pair.opening_um,
        pressed=player.pressing,
        place_speed_um_per_s=0.0 if rests else player.speed_um_per_s,
        place_acceleration_um_per_s2=0.0 if rests else pair.acceleration_um_per_s2,
        force_rate_mN_per_s=0.0 if rests else pair.force_rate_mN_per_s,
        opening_speed_um_per_s=0.0 if rests else pair.opening_speed_um_per_s,
        seeks=player.segment.kind == "seek" and not rests,
    )


def _resting(player: Player, pair: PairStand) -> Player:
    rest = replace(
        pair, opening_speed_um_per_s=0.0, acceleration_um_per_s2=0.0, force_rate_mN_per_s=0.0
    )
    return replace(player, speed_um_per_s=0.0, pair=rest)


def _goals(player: Player, pair: PairStand, duration_s: float) -> tuple[float, float]:
    """Place and opening at the end; a tip without a goal coasts to rest."""
    x, v = player.from_x_um, player.from_speed_um_per_s
    d, w = pair.from_opening_um, pair.from_opening_speed_um_per_s
    tips = 0.5 * d + x, 0.5 * d - x
    speeds = 0.5 * w + v, 0.5 * w - v
    one, two = (
        tip + 0.5 * duration_s * speed if goal is None else goal
        for goal, tip, speed in zip(
            pair.goals_um(player.segment.both, x), tips, speeds, strict=True
        )
    )
    return 0.5 * (one - two), one + two


def _led(player: Player, pair: PairStand, t_s: float) -> Player:
    duration_s = player.segment.duration_s
    if not duration_s:
        return _resting(player, pair)
    place_um, opening_um = _goals(player, pair, duration_s)
    place = move(player.from_x_um, player.from_speed_um_per_s, place_um, 0.0, duration_s)
    opening = move(
        pair.from_opening_um, pair.from_opening_speed_um_per_s, opening_um, 0.0, duration_s
    )
    return _placed(player, pair, place, opening, t_s)


def _placed(
    player: Player, pair: PairStand, place: Quintic, opening: Quintic, t_s: float
) -> Player:
    after = replace(
        pair,
        opening_um=opening.position(t_s),
        opening_speed_um_per_s=opening.speed(t_s),
        acceleration_um_per_s2=place.acceleration(t_s),
        force_rate_mN_per_s=0.0,
    )
    x_r_um, speed = place.position(t_s), place.speed(t_s)
    return replace(player, x_r_um=x_r_um, speed_um_per_s=speed, pair=after)


def _sought(player: Player, pair: PairStand, t_s: float, duration_s: float) -> Player:
    place_um, opening_um = _goals(player, pair, duration_s)
    up_s = player.segment.move_s or 0.0
    place = run_up(place_um - player.from_x_um, duration_s, up_s, t_s)
    opening = run_up(opening_um - pair.from_opening_um, duration_s, up_s, t_s)
    after = replace(
        pair,
        opening_um=pair.from_opening_um + opening[0],
        opening_speed_um_per_s=opening[1],
        acceleration_um_per_s2=0.0,
        force_rate_mN_per_s=0.0,
    )
    x_r_um = player.from_x_um + place[0]
    return replace(player, x_r_um=x_r_um, speed_um_per_s=place[1], pair=after)


def _pressed(player: Player, pair: PairStand, t_s: float) -> Player:
    """Place and force go to their ends in one time, each from its own speed, and rest there."""
    segment, both = player.segment, player.segment.both
    duration_s = segment.move_s or segment.duration_s
    if not duration_s:
        return _resting(player, pair)
    x, v = player.from_x_um, player.from_speed_um_per_s
    place_um = None if both is None else both.place_to_um
    if place_um is not None and both is not None and both.relative:
        place_um += x if player.contact_x_um is None else player.contact_x_um
    if place_um is None:
        brake_s = min(duration_s, 2.0 * BRAKE_UM / abs(v)) if v else duration_s
        place = move(x, v, x + 0.5 * brake_s * v, 0.0, brake_s)
    else:
        place = move(x, v, place_um, 0.0, duration_s)
    F, to_mN = player.from_force_mN, segment.force_to_mN
    force = move(F, player.from_rate_mN_per_s, F if to_mN is None else to_mN, 0.0, duration_s)
    after = replace(
        pair,
        acceleration_um_per_s2=place.acceleration(t_s),
        force_rate_mN_per_s=force.speed(t_s),
        opening_speed_um_per_s=0.0,
    )
    return replace(
        player,
        x_r_um=place.position(t_s),
        speed_um_per_s=place.speed(t_s),
        force_r_mN=force.position(t_s),
        pair=after,
    )


def _tracked(player: Player, pair: PairStand, t_s: float) -> Player:
    both = player.segment.both
    place = _point(None if both is None else both.place_path, player.from_x_um, t_s)
    force = _point(player.segment.path, player.from_force_mN, t_s)
    after = replace(
        pair,
        acceleration_um_per_s2=place[2],
        force_rate_mN_per_s=force[1],
        opening_speed_um_per_s=0.0,
    )
    return replace(
        player, x_r_um=place[0], speed_um_per_s=place[1], force_r_mN=force[0], pair=after
    )


def _point(path: Path | None, rests_at: float, t_s: float) -> tuple[float, float, float]:
    """Value, rate and acceleration; a path that is over, or none, rests."""
    if path is None:
        return rests_at, 0.0, 0.0
    value, rate, acceleration = path.point(t_s)
    if t_s >= path.duration_s:
        return value, 0.0, 0.0
    return value, rate, acceleration


def _driven(player: Player, pair: PairStand, ticks: int, t_s: float) -> Player:
    segment, both = player.segment, player.segment.both
    first_V, second_V = player.voltage_V, pair.second_voltage_V
    share = quintic(t_s / segment.duration_s) if segment.duration_s else 1.0
    if segment.voltages_V:
        first_V = segment.voltages_V[min(max(ticks, 1), len(segment.voltages_V)) - 1]
    elif segment.path is not None:
        begin_V = player.from_V if segment.path.relative else 0.0
        first_V = begin_V + segment.path.at(t_s)
    elif segment.voltage_to_V is not None:
        first_V = player.from_V + share * (segment.voltage_to_V - player.from_V)
    if both is not None and both.second_voltages_V:
        second_V = both.second_voltages_V[min(max(ticks, 1), len(both.second_voltages_V)) - 1]
    elif both is not None and both.second_path is not None:
        begin_V = pair.second_from_V if both.second_path.relative else 0.0
        second_V = begin_V + both.second_path.at(t_s)
    elif both is not None and both.second_to_V is not None:
        second_V = pair.second_from_V + share * (both.second_to_V - pair.second_from_V)
    return replace(player, voltage_V=first_V, pair=replace(pair, second_voltage_V=second_V))
