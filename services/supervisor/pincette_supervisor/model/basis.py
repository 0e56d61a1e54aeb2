"""What a model was measured with, by the rig file: what of it, changed, makes the model doubtful.

Limits, jobs and the loop's programs are none of it. A value of the rig file that a calibration
replaces is taken alone: where a person has changed it, only that value is not replaced any more.
"""

from collections.abc import Mapping
from typing import Any

from pincette.api.models import ModelChange
from pincette.config import RigFile
from pincette.config.calibration import CALIBRATED, OF_SECOND
from pincette_supervisor.model.quantities import values_of

MEASURED_WITH: Mapping[str, tuple[str, ...]] = {
    "rig": ("period_s",),
    "sensor": ("driver", "options", "offset_um", "direction"),
    "output": ("driver", "options"),
    "safety": ("safe_V",),
}
"""Keys by table: the instruments, the period, and the voltage at which the arm rests."""
BESIDE_THE_ARM = {
    "seed",
    "substep_s",
    "pace",
    "bead",
    "bead_contact_um",
    "environment_stiffness_mN_per_um",
    "passive_natural_frequency_rad_per_s",
    "passive_damping_ratio",
    "part",
    "pair",
    "baud",
    "truth",
    "scripts",
    "script",
}
"""Keys of a simulation that are neither its arm nor its instruments."""


def basis(rig: RigFile) -> dict[str, Any]:
    """Values by key, as JSON has them."""
    tree = rig.model_dump(mode="json")
    found = {
        f"{table}.{key}": tree[table][key] for table, keys in MEASURED_WITH.items() for key in keys
    }
    simulated: dict[str, Any] = tree["simulation"] or {}
    found |= {
        f"simulation.{key}": value for key, value in simulated.items() if key not in BESIDE_THE_ARM
    }
    return found | values_of(rig)


def changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[ModelChange]:
    """What differs."""
    return [
        ModelChange(key=key, before=before.get(key), now=now.get(key))
        for key in sorted({*before, *now})
        if before.get(key) != now.get(key)
    ]


def doubtful(found: list[ModelChange]) -> list[ModelChange]:
    """Changes that concern the whole model."""
    return [change for change in found if change.key not in (*CALIBRATED, *OF_SECOND)]


def words(found: list[ModelChange], version: int) -> str:
    """Changes since a version was chosen."""
    listed = ", ".join(f"{one.key} = {one.now!r}, was {one.before!r}" for one in found)
    return f"{listed}, when model {version} was chosen"
