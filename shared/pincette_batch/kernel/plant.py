"""The plant over a tick: the old voltage until the new one arrives, and the new one to its end.

What is here of the arms is one mode against a spring; for arms with modes of their own the linker
puts ``joined_arms`` and ``joined_force_mN`` there.
"""

from typing import Any, NamedTuple

from pincette.sim.plant.arms_substeps import pass_substeps
from pincette.sim.plant.drive import Electrical, drive_substeps, rest_of
from pincette.sim.plant.motion import Tips, force_mN, motion_of, tips_of
from pincette.sim.plant.plain_arm import plain_substeps
from pincette_batch.kernel.constants import Bench, Rows, Stretch


class Moved(NamedTuple):
    """Where the plant is."""

    target_V: float
    electrical: Electrical
    x_um: float
    arms: Any
    """Position and speed of one mode; else ``Tips``."""


def pass_tick(k: Bench, moved: Moved, target_V: float, scratch: Rows) -> Moved:
    """``SimulatedRig.put_out`` in lockstep."""
    moved = pass_stretch(k, k.before, moved, scratch)
    moved = pass_stretch(k, k.before_rest, moved, scratch)
    moved = Moved(target_V, moved.electrical, moved.x_um, moved.arms)
    moved = pass_stretch(k, k.after, moved, scratch)
    return pass_stretch(k, k.after_rest, moved, scratch)


def pass_stretch(k: Bench, stretch: Stretch, moved: Moved, scratch: Rows) -> Moved:
    """Substeps of one length; ``plant.advance`` without the time in which all has settled."""
    count = stretch.substeps
    if count == 0:
        return moved
    rests_um, other, untold = scratch[0, :count], scratch[1, :count], scratch[0, :0]
    start_um = rest_of(stretch.drive, moved.electrical)
    electrical = drive_substeps(
        stretch.drive, moved.electrical, moved.target_V, untold, rests_um, untold, other
    )
    x_um, arms = arms_passed(k, stretch, moved.arms, start_um, rests_um, other)
    return Moved(moved.target_V, electrical, x_um, arms)


def arms_passed(
    k: Bench, stretch: Stretch, arms: Any, _start_um: float, rests_um: Rows, dents_um: Rows
) -> tuple[float, Any]:
    """``plain_arm.move_plain_arm``."""
    tip = plain_substeps(stretch.arms, k.first_touch_um, arms, rests_um, dents_um[:0])
    return tip[0], tip


def true_force_mN(k: Bench, moved: Moved) -> float:
    """F = K_e·max(0, x - x_b)."""
    return k.stiffness_mN_per_um * max(0.0, moved.x_um - k.first_touch_um)


def joined_arms_passed(
    k: Bench, stretch: Stretch, arms: Any, start_um: float, rests_um: Rows, dents_um: Rows
) -> tuple[float, Any]:
    """``joined_arms.move_arms``, and ``tips`` of the state that it leaves."""
    motion = motion_of(stretch.arms, arms, start_um, there=k.there)
    motion = pass_substeps(stretch.arms, motion, rests_um, dents_um, dents_um[:0])
    found = tips_of(stretch.arms, motion)
    first, second, y_um, first_speed, second_speed, y_speed = found.values
    x_um, speed = first + second, first_speed + second_speed
    # The state keeps the tip and its second mode, so that the first is what is left.
    values = (x_um - second, second, y_um, speed - second_speed, second_speed, y_speed)
    return x_um, Tips(values, found.joined, found.dent_um)


def joined_true_force_mN(k: Bench, moved: Moved) -> float:
    """``joined_arms.arms_force_mN``."""
    if not moved.arms.joined:
        return 0.0
    start_um = rest_of(k.before.drive, moved.electrical)
    return force_mN(k.before.arms, motion_of(k.before.arms, moved.arms, start_um, there=k.there))
