"""Use of a rig since its last calibration, from the jobs in the journal."""

from contextlib import suppress
from datetime import datetime
from typing import NamedTuple

from pincette.api.rigs import UseLimit, UseSinceCalibration
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.model import RigModel

S_PER_H = 3600.0


class Use(NamedTuple):
    """Totals since a time; None: of all jobs."""

    since: str | None
    strokes: int = 0
    contacts: int = 0
    armed_s: float = 0.0

    @property
    def hours(self) -> float:
        """Return the armed time in hours."""
        return self.armed_s / S_PER_H


class UseCounter:
    """Totals of one rig, read from the journal again only after a job or a calibration."""

    def __init__(self, model: RigModel, store: Store) -> None:
        self._model, self._store = model, store
        self._known: Use | None = None
        self._changes = 0
        self._read_at = -1
        """Value of ``_changes`` when the totals were read."""

    def mark_changed(self) -> None:
        """Have the totals read again, since the result of a job was stored."""
        self._changes += 1

    def totals(self) -> Use:
        """Return the use since the newest acceptance in the model in use."""
        accepted = self._model.in_use.acceptances.values()
        since = max((one.accepted_at for one in accepted), default=None)
        known, changes = self._known, self._changes
        if known is not None and known.since == since and self._read_at == changes:
            return known
        with suppress(StoreError):  # the alarm of the journal states it; the last totals are kept
            rig = self._model.file.rig.name
            known = self._known = Use(since, *self._store.use_since(rig, since))
            self._read_at = changes
        return known or Use(since)

    def newest(self, now: datetime) -> UseSinceCalibration:
        """Return the totals, and the limits that they and the dates exceed."""
        due: list[UseLimit] = ["days"] if self._model.overdue(now) else []
        use = self.totals()
        return UseSinceCalibration(
            since=use.since,
            strokes=use.strokes,
            contacts=use.contacts,
            hours=use.hours,
            due=[*due, *self._exceeded(use)],
        )

    def _exceeded(self, use: Use) -> dict[UseLimit, float]:
        """Return the limits of the rig file that the totals reach."""
        valid = self._model.file.calibration
        limits: dict[UseLimit, float | None] = {
            "strokes": valid.valid_strokes,
            "contacts": valid.valid_contacts,
            "hours": valid.valid_hours,
        }
        return {
            name: limit
            for name, limit in limits.items()
            if limit is not None and getattr(use, name) >= limit
        }

    def reasons(self) -> list[str]:
        """Return why a calibration is due after this use, in words; empty if it is not."""
        use = self.totals()
        return [
            f"{getattr(use, name):.6g} {name} {_since(use)}, limit {limit:g}; calibrate again"
            for name, limit in self._exceeded(use).items()
        ]

    def words(self) -> str:
        """Return the totals in words."""
        use = self.totals()
        counts = f"{use.strokes} strokes, {use.contacts} contacts and {use.hours:.1f} hours"
        return f"{counts} {_since(use)}"


def _since(use: Use) -> str:
    if use.since is None:
        return "in all"
    return f"since a calibration, of whichever kind, was accepted at {use.since}"
