"""What is known of the part and of the program that plays, from the newest samples."""

from typing import Literal, cast

from pincette.messages import Applied, Position
from pincette.topics import APPLIED, POSITION
from pincette_supervisor.planning.present import Present
from pincette_supervisor.running.site import Site

Part = Literal["none", "held", "unknown"]

PLAYING_S = 1.0
"""An actuator that said so long ago that it is armed is not heard any more."""


def newest_applied(site: Site) -> Applied | None:
    """What the actuator said last."""
    return cast("Applied | None", site.observer.newest(APPLIED))


def part(site: Site) -> Part:
    """Whether the gripper holds a part, as the actuator was last told."""
    applied = newest_applied(site)
    state, _ = site.health.latch()
    if applied is None or state in ("unknown", "ramping", "latched"):
        return "unknown"
    return "held" if applied.part_held else "none"


def plays(site: Site) -> bool:
    """Whether a program plays."""
    silent_s = site.observer.silent_s(APPLIED)
    return site.health.latch()[0] == "armed" and silent_s is not None and silent_s < PLAYING_S


def held_words(site: Site) -> str:
    """Why a job that needs an empty gripper cannot start; empty where it can."""
    if part(site) != "held":
        return ""
    return "a part is held: only hold and release can start"


def reset_words(site: Site, cause: str) -> str:
    """What a person must do about the actuator's latch."""
    name = site.rig.rig.name
    return (
        f"the actuator is latched ({site.trip_words(cause)}): see that the rig is safe, then run "
        f'`pincette reset`, or POST /api/v1/rigs/{name}/reset with {{"acknowledge": true}}'
    )


def present(site: Site) -> Present | None:
    """Where the arm stands; None where nothing is known of it."""
    applied = newest_applied(site)
    if applied is None:
        return None
    position = cast("Position | None", site.observer.newest(POSITION))
    x_um = position.x_um if position is not None and position.valid else None
    known = part(site)
    return Present(applied.voltage_V, x_um, None if known == "unknown" else known == "held")
