"""When a calibration is to be made again: its time is over, or it was made with other instruments.

Times are in UTC, as ISO 8601 has them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Literal

from pincette_supervisor.model.model_file import Acceptance


def due_at(measured_at: str, valid_days: float | None) -> str | None:
    """When what was measured is to be measured again; None where it holds without an end."""
    if valid_days is None:
        return None
    try:
        due = datetime.fromisoformat(measured_at) + timedelta(days=valid_days)
    except OverflowError:
        return None
    return due.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def overdue(accepted: Acceptance, now: datetime) -> bool:
    """Whether it should have been measured again by now."""
    return accepted.due_at is not None and datetime.fromisoformat(accepted.due_at) < now


@dataclass(frozen=True, slots=True)
class Due:
    """Why a calibration should be made again."""

    code: Literal["overdue", "instrument_changed"]
    text: str


def due(name: str, accepted: Acceptance, present: Mapping[str, str], now: datetime) -> list[Due]:
    """Why a calibration should be made again; nothing where it is still good.

    Parameters
    ----------
    name
        The calibration.
    accepted
        How one of its values came into use.
    present
        Serial numbers of the rig file, by table.
    """
    found = [
        Due("instrument_changed", f"{table} is {number}, calibration {name} was made with {then}")
        for table, number in present.items()
        if (then := accepted.serial_numbers.get(table, number)) != number
    ]
    if overdue(accepted, now):
        found.append(Due("overdue", f"calibration {name} is overdue since {accepted.due_at}"))
    return found


def warnings(
    sources: Mapping[str, str],
    acceptances: Mapping[str, Acceptance],
    present: Mapping[str, str],
    now: datetime,
) -> list[str]:
    """Which calibrations should be made again, and why, in words.

    Parameters
    ----------
    sources, acceptances
        By quantity in use: the calibration it comes from, and how it was accepted.
    present
        Serial numbers of the rig file, by table.
    """
    found: dict[str, list[str]] = {}
    for quantity, accepted in acceptances.items():
        for reason in due(sources[quantity], accepted, present, now):
            found.setdefault(reason.text, []).append(quantity)
    return [f"{', '.join(names)}: {why}; calibrate again" for why, names in found.items()]
