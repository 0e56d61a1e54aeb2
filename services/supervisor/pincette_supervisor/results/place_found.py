"""Comparison of the place where a part was met with the place that its job was given."""

from math import hypot

from pincette.api.places import PlaceFound, PlannedPlace
from pincette.api.results import JobResult
from pincette.config import RigFile
from pincette.control.force.estimation import COVERAGE
from pincette.records.columns import Columns
from pincette_supervisor.plugin import Planned


def place_found(result: JobResult, table: Columns, planned: Planned) -> PlaceFound | None:
    """Return where the part was found, and the deviation of the given place from it; None if no
    place was given."""
    place, rig = planned.plan.place, planned.armed.rig
    if place is None:
        return None
    pair = rig.second is not None
    found_um: float | None = getattr(result, "met_place_um" if pair else "contact_x_um", None)
    found_U_um = COVERAGE * rig.sensor.noise_um
    if not pair and (error_um := getattr(result, "contact_x_error_um", None)) is not None:
        found_U_um = COVERAGE * error_um
    found = PlaceFound(
        source=place.source,
        age_s=place.age_s,
        given_um=place.x_um,
        found_um=found_um,
        difference_um=None if found_um is None else found_um - place.x_um,
        uncertainty_um=None if found_um is None else hypot(place.u_um, found_U_um),
    )
    return found.model_copy(update=_width(place, table, rig)) if pair else found


def _width(place: PlannedPlace, table: Columns, rig: RigFile) -> dict[str, float | None]:
    """Return the width of the part, from the tips when both were in contact, corrected for its
    compression."""
    if rig.second is None or rig.second.gap_um is None or place.width_um is None:
        return {}
    names = ("contact_x_um", "x_um", "second_x_um", "force_mN")
    rows = zip(*(table[name] for name in names), strict=True)
    met = next((row for row in rows if None not in row), None)
    if met is None:
        return {"width_given_um": place.width_um}
    _, first_um, second_um, force_mN = met
    pressed_um = force_mN / rig.part.stiffness_mN_per_um
    width_um = rig.second.gap_um - (first_um + second_um) + pressed_um
    noise_um = COVERAGE * hypot(rig.sensor.noise_um, rig.second.sensor.noise_um)
    off_um = hypot(noise_um, rig.part.stiffness_tolerance * pressed_um)
    return {
        "width_given_um": place.width_um,
        "width_found_um": width_um,
        "width_difference_um": width_um - place.width_um,
        "width_uncertainty_um": hypot(place.u_width_um or 0.0, off_um),
    }
