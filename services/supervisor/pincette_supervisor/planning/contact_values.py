"""What a job that meets a part works with: its request completed by the rig file."""

from typing import Any

from pydantic import BaseModel

from pincette.config import RigFile

CONTACT_WISHES = ("load_s", "approach_um_per_s", "seek_um_per_s", "contact_force_mN")


def contact_wishes(request: BaseModel, names: tuple[str, ...], rig: RigFile) -> dict[str, Any]:
    """Members of a request by their names, those left out as the rig file's grip has them."""
    return {
        name: wish if (wish := getattr(request, name)) is not None else getattr(rig.grip, name)
        for name in names
    }


def part_values(rig: RigFile) -> dict[str, float]:
    """What the rig file says of the contact."""
    part = rig.part
    return {
        "zero_s": rig.grip.zero_s,
        "contact_um": part.contact_um,
        "contact_tolerance_um": part.contact_tolerance_um,
        "stiffness_mN_per_um": part.stiffness_mN_per_um,
        "stiffness_tolerance": part.stiffness_tolerance,
    }
