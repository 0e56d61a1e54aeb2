"""The references of the coming sample: where a segment wants position, force or voltage."""

from pincette.control.planning.paths import Path
from pincette.control.planning.profiles import move, quintic
from pincette_controller.playing import Player, References


def refer(player: Player, ticks: int, period_s: float) -> References:
    """References at ``ticks`` of the segment: for the sample that the coming voltage leads to."""
    segment, t_s = player.segment, ticks * period_s
    now = player.references
    if segment.kind == "free" and segment.x_to_um is not None and segment.duration_s:
        path = move(
            player.from_x_um,
            player.from_speed_um_per_s,
            segment.x_to_um,
            0.0,
            segment.duration_s,
        )
        return References(path.position(t_s), path.speed(t_s), now.force_r_mN, now.voltage_V)
    if segment.kind == "seek" and segment.x_to_um is not None and segment.duration_s:
        speed = (segment.x_to_um - player.from_x_um) / segment.duration_s
        x_r_um = player.from_x_um + speed * t_s
        return References(x_r_um, speed, now.force_r_mN, now.voltage_V)
    if segment.kind == "force" and segment.force_to_mN is not None:
        return _press(player, now, segment.force_to_mN, t_s)
    if segment.kind == "voltage" and segment.voltage_to_V is not None and segment.duration_s:
        share = quintic(t_s / segment.duration_s)
        way_V = segment.voltage_to_V - player.from_V
        return now._replace(voltage_V=player.from_V + share * way_V)
    if segment.kind == "voltage" and segment.path is not None:
        begin_V = player.from_V if segment.path.relative else 0.0
        return now._replace(voltage_V=begin_V + segment.path.at(t_s))
    if segment.kind == "path" and segment.path is not None:
        return _track(player, now, segment.path, t_s)
    return now._replace(speed_um_per_s=0.0)


def _press(player: Player, now: References, force_to_mN: float, t_s: float) -> References:
    """Move F_r and x_r together along the contact line."""
    duration_s = player.segment.move_s or player.segment.duration_s
    share = quintic(t_s / duration_s) if duration_s else 1.0
    x_e_um, K_e = player.contact_x_um, player.K_e_mN_per_um
    if x_e_um is None or not K_e:
        return now
    x_to_um = x_e_um + force_to_mN / K_e
    x_r_um = player.from_x_um + share * (x_to_um - player.from_x_um)
    force_r_mN = player.from_force_mN + share * (force_to_mN - player.from_force_mN)
    return References(x_r_um, 0.0, force_r_mN, now.voltage_V)


def _track(player: Player, now: References, path: Path, t_s: float) -> References:
    """Follow a path, in force along the contact line or in position."""
    value, rate, _ = path.point(t_s)
    if path.quantity == "position":
        return References(value, rate, now.force_r_mN, now.voltage_V)
    x_e_um, K_e = player.contact_x_um, player.K_e_mN_per_um
    if x_e_um is None or not K_e:
        return now
    return References(x_e_um + value / K_e, 0.0, value, now.voltage_V)
