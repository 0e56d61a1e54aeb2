"""Readings of a rig, with the kind and unit of each."""

import math
import time
from collections.abc import Iterable, Mapping
from typing import Any

from bluesky.protocols import Reading
from event_model import DataKey

from pincette.api.jobs import Job
from pincette.api.rigs import Rig
from pincette.client.following import LETTING_GO
from pincette.core.units import unit_of

NUMBERS = ("force_mN", "force_uncertainty_mN", "x_um", "voltage_V")
"""Numbers of the newest sample; NaN if unknown."""
TEXTS = ("part", "job")
STANDING = ("rig", "rig_digest", "model_digest", "period_s")
"""Configuration fields that are read once for a run."""
COLUMNS = (
    "seq",
    "t_s",
    "phase",
    "x_um",
    "x_r_um",
    "force_mN",
    "force_r_mN",
    "force_uncertainty_mN",
    "voltage_V",
    "sliding_um",
)
"""Columns read from a record; a record contains more columns."""
OF_SECOND = ("second_x_um", "second_force_mN", "second_voltage_V")
"""Fields of the second arm, in the newest sample and in a record. Other fields are those of the
first arm."""
OF_PART = ("place_um", "place_r_um")
"""Columns of a record for a part that two arms hold."""
SAID = (*TEXTS, "phase", "rig", "rig_digest", "model_digest")
COUNTED = ("seq",)


def numbers(arms: int) -> tuple[str, ...]:
    """Return the numeric fields of a rig with this number of driven arms."""
    return NUMBERS if arms == 1 else (*NUMBERS, *OF_SECOND)


def columns(arms: int) -> tuple[str, ...]:
    """Return the columns collected from a record of a rig with this number of driven arms."""
    return COLUMNS if arms == 1 else (*COLUMNS, *OF_SECOND, *OF_PART)


def data_keys(name: str, source: str, fields: Iterable[str]) -> dict[str, DataKey]:
    """Return the data keys of a device's fields; the suffix of a name determines the unit."""
    return {f"{name}-{field}": _data_key(source, field) for field in fields}


def readings(
    name: str, found: Mapping[str, Any], age_s: float | None = 0.0
) -> dict[str, Reading[Any]]:
    """Return values as readings of bluesky, with the time at which they were measured."""
    at_s = time.time() - (age_s or 0.0)
    return {f"{name}-{field}": Reading(value=one, timestamp=at_s) for field, one in found.items()}


def newest(rig: Rig) -> dict[str, Any]:
    """Return the newest sample of a rig, whether a part is held, and the job that uses the rig."""
    now = rig.newest
    values = {field: None if now is None else getattr(now, field) for field in numbers(rig.arms)}
    known = {field: math.nan if value is None else value for field, value in values.items()}
    return {**known, "part": rig.part, "job": rig.active_job or ""}


def setpoint_mN(rig: Rig, job: Job | None) -> float:
    """Return the requested force in mN: 0 if no part is held, NaN if it is unknown.

    Parameters
    ----------
    job
        Job that uses the rig; None if there is none.
    """
    if job is None:
        return 0.0 if rig.part == "none" else math.nan
    now = job.progress
    if job.ended_at is not None:  # the job was stopped; its part is held at its last reference
        force_mN = None if now is None or not now.held else now.force_r_mN
    else:
        lets_go = now is not None and now.phase in LETTING_GO
        force_mN = None if lets_go else job.values.get("force_mN")
    return float(force_mN) if isinstance(force_mN, int | float) else math.nan


def standing(rig: Rig) -> dict[str, Any]:
    """Return the rig, rig file and model."""
    found = (rig.name, rig.digest, rig.model.digest, rig.period_s)
    return dict(zip(STANDING, found, strict=True))


def _data_key(source: str, field: str) -> DataKey:
    if field in SAID:
        return DataKey(source=source, dtype="string", shape=[])
    if field in COUNTED:
        return DataKey(source=source, dtype="integer", shape=[])
    return DataKey(source=source, dtype="number", shape=[], units=unit_of(field))
