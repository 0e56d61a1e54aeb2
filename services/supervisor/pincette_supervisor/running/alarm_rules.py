"""What stands in alarm at a rig, as far as it can be seen now: rules over what is known."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from pincette.messages import Estimate
from pincette.topics import ESTIMATE, LOOP, POSITION
from pincette_supervisor.journal.alarm_rows import Severity
from pincette_supervisor.running.site import Site

PROGRAMS = (*LOOP, "recorder", "rig")
FRESH_S = 1.0
"""An estimate older than this says nothing of the sensor any more."""
STUCK = "sensor stuck"
"""How the estimator's words of a sensor begin that does not follow the voltage."""
MB = 1e6


@dataclass(frozen=True, slots=True)
class Standing:
    """Something that is not as it should be, for as long as it is so."""

    cause: str
    words: str
    severity: Severity = "alarm"


def standing(site: Site) -> Iterator[Standing]:
    """Everything that is not as it should be."""
    gone = site.observer.gone(PROGRAMS)
    for program in gone:
        yield Standing(f"program.{program}", f"{program} has gone: killed, hung or cut off")
    if "sensor" not in gone:
        yield from _sensor(site)
    yield from room(site)
    if site.store.trouble:
        yield Standing("store", site.store.trouble)


def _sensor(site: Site) -> Iterator[Standing]:
    observer = site.observer
    estimate = cast("Estimate | None", observer.newest(ESTIMATE))
    age_s = observer.age_s(ESTIMATE)
    fresh = age_s is not None and age_s < FRESH_S
    fault = estimate.fault if estimate is not None and fresh else ""
    if fault.startswith(STUCK):
        yield Standing("sensor.stuck", fault)
    elif not site.rig.lockstep and observer.age_s(POSITION) is not None:
        trouble = site.health.sensor_trouble()
        if trouble:
            yield Standing("sensor", f"sensor {trouble}")


def room(site: Site) -> Iterator[Standing]:
    """Say so where the disk has less room than a record needs to begin."""
    free_MB, limit_MB = free_on(site.records), site.rig.recorder.min_free_MB
    if free_MB is not None and free_MB < limit_MB:
        words = f"disk of {site.records}: {free_MB:.0f} MB free, limit {limit_MB:g} MB"
        yield Standing("disk", words, "warning")


def free_on(folder: Path) -> float | None:
    """Room in MB on the disk of a folder, which may not be there yet; None where nobody knows."""
    for place in (folder, *folder.parents):
        if place.exists():
            try:
                return shutil.disk_usage(place).free / MB
            except OSError:
                return None
    return None
