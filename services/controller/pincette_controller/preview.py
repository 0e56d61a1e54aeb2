"""What a law that looks ahead is told of the program: how x_r moves, and on which contact line.

The derivatives are those of the references of ``player_state``, kind by kind, so that no law pays
for them that does not ask.
"""

from pincette.control.laws.planned_motion import RESTING, PlannedMotion
from pincette.control.planning.profiles import Quintic, move, run_up
from pincette_controller.player_state import Player


def planned_motion(player: Player, period_s: float) -> PlannedMotion:
    """Derivatives of x_r at the sample that the player's references are for, and the contact."""
    speed, acceleration = (0.0, 0.0)
    if not (player.ended or player.paused or player.segment.open_loop):
        speed, acceleration = _derivatives(player, player.ticks * period_s)
    x_e_um, K_e = player.contact_x_um, player.K_e_mN_per_um
    if not player.pressing or x_e_um is None or K_e is None:
        if speed == 0.0 and acceleration == 0.0:
            return RESTING
        return PlannedMotion(speed, acceleration)
    return PlannedMotion(speed, acceleration, K_e, x_e_um)


def _derivatives(player: Player, t_s: float) -> tuple[float, float]:
    segment, K_e = player.segment, player.K_e_mN_per_um
    duration_s = segment.duration_s or 0.0
    if segment.kind == "free" and segment.x_to_um is not None and duration_s:
        return _of(move(*_begun(player), segment.x_to_um, 0.0, duration_s), t_s)
    if segment.kind == "seek" and segment.x_to_um is not None and duration_s:
        way_um, up_s = segment.x_to_um - player.from_x_um, segment.move_s or 0.0
        speed = run_up(way_um, duration_s, up_s, t_s)[1]
        if not 0.0 < t_s < up_s:
            return speed, 0.0
        top, s = way_um / (duration_s - 0.5 * up_s), t_s / up_s
        return speed, top * 6.0 * s * (1.0 - s) / up_s
    if segment.kind == "force" and segment.force_to_mN is not None and K_e:
        move_s = segment.move_s or duration_s
        if not move_s:
            return 0.0, 0.0
        if segment.follows:
            begun = player.from_force_mN, player.from_rate_mN_per_s
            speed, acceleration = _of(move(*begun, segment.force_to_mN, 0.0, move_s), t_s)
            return speed / K_e, acceleration / K_e
        x_to_um = (player.contact_x_um or 0.0) + segment.force_to_mN / K_e
        return _of(move(player.from_x_um, 0.0, x_to_um, 0.0, move_s), t_s)
    if segment.kind == "path" and segment.path is not None:
        _, rate, acceleration = segment.path.point(t_s)
        if segment.path.quantity == "position":
            return rate, acceleration
        return (rate / K_e, acceleration / K_e) if K_e else (0.0, 0.0)
    return 0.0, 0.0


def _begun(player: Player) -> tuple[float, float]:
    return player.from_x_um, player.from_speed_um_per_s


def _of(path: Quintic, t_s: float) -> tuple[float, float]:
    if not 0.0 < t_s < path.duration_s:
        return path.end_speed if t_s > 0.0 else path.start_speed, 0.0
    return path.speed(t_s), path.acceleration(t_s)
