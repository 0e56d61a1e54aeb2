"""What befalls a part: it breaks, or falls once it was lifted; pure."""

from pincette.sim.plant.parameters import PartParameters
from pincette.sim.plant.state import Event


def befall(
    part: PartParameters, held_s: float, force_mN: float, dt_s: float, now_s: float
) -> tuple[float, Event | None]:
    """For how long the force has carried the part after ``dt_s`` with it, and how it went if so.

    Lifted is a part that the force has carried, F >= weight/(2µ), for ``lift_after_s``.
    """
    if force_mN > part.break_mN:
        text = f"the part broke: {force_mN:.3f} mN are above {part.break_mN:.3f} mN"
        return 0.0, Event(now_s, "broken", text)
    if force_mN >= part.hold_mN:
        return held_s + dt_s, None
    if held_s < part.lift_after_s:
        return 0.0, None
    text = f"the part fell: {force_mN:.4f} mN are below the {part.hold_mN:.4f} mN that carry it"
    return 0.0, Event(now_s, "lost", text)
