"""Position after the last move, so that relative steps do not add up the noise."""

from collections.abc import Mapping, Sequence

from pincette_supervisor.journal.tables import JobRow
from pincette_supervisor.plugin import Present

SAME_V = 0.05
"""Difference of the voltage up to which the arm has not been driven since."""
NEAR_UM = 1.0
"""Distance from the last target up to which the arm counts as being there."""


def last_pose_um(rows: Sequence[JobRow], present: Present) -> float | None:
    """Return the target of the last move, or the mean position of its rest where it has none.

    None where the last job that was armed is not a move that succeeded, or where voltage or
    position are not those that it ended with: then the newest reading is what is known.
    """
    armed = [row for row in rows if row.epoch is not None]
    last = max(armed, key=lambda row: row.epoch or 0, default=None)
    if last is None or last.kind != "move" or last.state != "succeeded" or not last.result:
        return None
    ends_at: Mapping[str, float | None] = last.result.get("ends_at") or {}
    target_um: float | None = last.result.get("target_um")
    voltage_V, pose_um = ends_at.get("voltage_V"), target_um
    if pose_um is None:
        pose_um = ends_at.get("x_um")
    if pose_um is None or voltage_V is None:
        return None
    if present.voltage_V is None or present.x_um is None:
        return None
    if abs(voltage_V - present.voltage_V) > SAME_V or abs(pose_um - present.x_um) > NEAR_UM:
        return None
    return pose_um
