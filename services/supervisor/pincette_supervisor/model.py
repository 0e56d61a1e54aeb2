"""The model in use: the rig file, overridden by an accepted version of a model.

A version is a file ``NNNN-<digest>.json`` that is never changed after it was written; it names the
previous version.
"""

import json
import threading
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, Field, ValidationError

from pincette.api.models import ModelChange
from pincette.config import Calibration, ConfigError, RigFile, calibrated
from pincette.config.calibration import CALIBRATED, OF_SECOND
from pincette.core.files import make_folder, replace_file
from pincette.core.validation_wording import refusal
from pincette_supervisor.journal.store import Store, utc_now
from pincette_supervisor.plugin import ModelInUse
from pincette_supervisor.plugin.model_in_use import (
    FROZEN,
    RIG_FILE_ALONE,
    Acceptance,
    merged,
    rig_file_alone,
    values_of,
)


class StoredModel(BaseModel):
    """One version of the model."""

    model_config = FROZEN

    version: int = Field(ge=1)
    digest: str
    """Digest of the values."""
    rig: str
    rig_file_digest: str
    """Digest of the rig file with which the values were found."""
    basis: dict[str, Any] = Field(default_factory=dict)
    """Entries of that rig file on which the measurement depends."""
    made_at: str
    values: dict[str, Any]
    """Values by quantity; missing quantities have the rig file's value."""
    sources: dict[str, str]
    """Calibration that found each quantity."""
    uncertainties: dict[str, float | None]
    """Standard uncertainty of each quantity; null if none can be stated."""
    acceptances: dict[str, Acceptance] = Field(default_factory=dict)
    """Acceptance of each quantity."""
    previous: str
    """Digest of the model that was in use before; empty if that was the rig file alone."""

    @property
    def calibration(self) -> Calibration:
        """Return the calibration that is sent with a program.

        Raises ConfigError for an unknown quantity.
        """
        try:
            return Calibration(values=self.values, sources=self.sources)
        except ValidationError as error:
            raise ConfigError(refusal(error.errors()[0])) from error


@dataclass(frozen=True, slots=True)
class ModelFiles:
    """The versions of one rig, in a folder."""

    folder: Path

    def numbers(self) -> list[int]:
        """Return the numbers of the existing versions, oldest first."""
        return sorted(self._paths())

    def _paths(self) -> dict[int, Path]:
        return {
            int(path.stem.partition("-")[0]): path
            for path in self.folder.glob("[0-9][0-9][0-9][0-9]-*.json")
        }

    def read(self, version: int) -> StoredModel:
        """Read a version.

        Raises
        ------
        ConfigError
            If there is none, or its file has changed since it was written.
        """
        path = self._paths().get(version)
        if path is None:
            raise ConfigError(f"no model {version}; existing: {self.numbers() or 'none'}")
        try:
            model = StoredModel.model_validate_json(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ConfigError(f"model file {path.name} cannot be used: {error}") from error
        if model.version != version:
            raise ConfigError(
                f"model file {path.name} was changed: it names version {model.version}"
            )
        if model.digest != model.calibration.digest:
            raise ConfigError(
                f"model file {path.name} was changed: its values have the digest "
                f"{model.calibration.digest}, it names {model.digest}"
            )
        return model

    def write(self, model: StoredModel) -> None:
        """Write a version to the disk atomically; raises OSError."""
        make_folder(self.folder)
        path = self.folder / f"{model.version:04d}-{model.digest}.json"
        text = json.dumps(model.model_dump(mode="json"), indent=2, ensure_ascii=False)
        replace_file(path, text.encode() + b"\n")


# Conditions under which a calibration must be repeated: it has expired, or it was made with other
# instruments. Times are in UTC, in ISO 8601 format.


def due_at(measured_at: str, valid_days: float | None) -> str | None:
    """Return the time at which a value must be measured again; None if it does not expire."""
    if valid_days is None:
        return None
    try:
        due = datetime.fromisoformat(measured_at) + timedelta(days=valid_days)
    except OverflowError:
        return None
    return due.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def overdue(accepted: Acceptance, now: datetime) -> bool:
    """Return True if the calibration must be repeated."""
    return accepted.due_at is not None and datetime.fromisoformat(accepted.due_at) < now


@dataclass(frozen=True, slots=True)
class Due:
    """Reason why a calibration should be repeated."""

    code: Literal["overdue", "instrument_changed"]
    text: str


def due(name: str, accepted: Acceptance, present: Mapping[str, str], now: datetime) -> list[Due]:
    """Return the reasons why a calibration should be repeated; empty if it is still valid.

    Parameters
    ----------
    name
        The calibration.
    accepted
        Acceptance of one of its values.
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
    """Return warnings of calibrations that should be repeated, with the reasons.

    Parameters
    ----------
    sources, acceptances
        The calibration that found each quantity in use, and its acceptance, by quantity.
    present
        Serial numbers of the rig file, by table.
    """
    found: dict[str, list[str]] = {}
    for quantity, accepted in acceptances.items():
        for reason in due(sources[quantity], accepted, present, now):
            found.setdefault(reason.text, []).append(quantity)
    return [f"{', '.join(names)}: {why}; calibrate again" for why, names in found.items()]


# Rig file entries on which a model's measurement depends: a change of one of them makes the model
# doubtful. Limits, jobs and the loop's programs are not among them. A rig file value that a
# calibration replaces is treated separately: if a person has changed it, only that value is no
# longer replaced.

MEASURED_WITH: Mapping[str, tuple[str, ...]] = {
    "rig": ("period_s",),
    "sensor": ("driver", "options", "offset_um", "direction"),
    "output": ("driver", "options"),
    "safety": ("safe_V",),
}
"""Rig file keys by table on which measurements depend: the instruments, the period, and the voltage
at which the arm rests."""
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
"""Keys of a simulation that describe neither its arm nor its instruments."""


def basis(rig: RigFile) -> dict[str, Any]:
    """Return the rig file values on which measurements depend, by key, as JSON represents them."""
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
    """Return the values that differ."""
    return [
        ModelChange(key=key, before=before.get(key), now=now.get(key))
        for key in sorted({*before, *now})
        if before.get(key) != now.get(key)
    ]


def doubtful(found: list[ModelChange]) -> list[ModelChange]:
    """Return the changes that make the whole model doubtful."""
    return [change for change in found if change.key not in (*CALIBRATED, *OF_SECOND)]


def words(found: list[ModelChange], version: int) -> str:
    """Describe changes since a version was chosen, in words."""
    listed = ", ".join(f"{one.key} = {one.now!r}, was {one.before!r}" for one in found)
    return f"{listed}, when model {version} was chosen"


KEPT_CHANGES = 100
"""Largest number of instrument changes that are kept; older ones do not affect values in use."""


class RigModel:
    """Model that is used with a rig; kept across restarts.

    A model that was measured with other instruments or another arm (``basis``) is not applied
    without confirmation by a person: until then only the rig file is in use, and ``trouble`` gives
    the reason. If a person has changed a value in the rig file since the model was chosen, the
    model does not replace that value.
    """

    def __init__(self, rig_file: RigFile, folder: Path, store: Store) -> None:
        self.file = rig_file
        self.trouble = ""
        self.changed: list[ModelChange] = []
        """Changes that prevent the use of the model."""
        self.set_aside: list[ModelChange] = []
        """Changed rig file values that the model does not replace, since a person has changed
        them.
        """
        self._basis = basis(rig_file)
        self.files = ModelFiles(folder / rig_file.rig.name)
        self._store = store
        self._note = f"model in use: {rig_file.rig.name}"
        self._instruments = Instruments(store, rig_file.rig.name, rig_file.serial_numbers)
        self._lock = threading.Lock()
        self.in_use = rig_file_alone(rig_file)
        self._take_up()

    @property
    def rig(self) -> RigFile:
        """Return the rig file with the model in use."""
        return self.in_use.rig

    @property
    def digest(self) -> str:
        """Return the digest of the rig file, on which all programs must agree."""
        return self.in_use.rig_file_digest

    def _take_up(self) -> None:
        """Use the model that was in use before a restart."""
        noted = self._store.get_note(self._note)
        if noted is None:
            return
        version, before = _noted(noted)
        if version == RIG_FILE_ALONE:
            return
        alone = "`pincette model use 0` for the rig file alone"
        try:
            stored = self.files.read(version)
        except ConfigError as error:
            self.trouble = (
                f"model {version} is not used, because {error}: restore the file and run "
                f"`pincette model use {version}`, or {alone}"
            )
            return
        try:
            found = changes(before, self._basis)
            self.changed = doubtful(found)
            if self.changed:
                raise ConfigError(words(self.changed, version))
            self.set_aside = [change for change in found if change.key in stored.values]
            self.in_use = self._laid(stored, {change.key for change in self.set_aside})
        except ConfigError as error:
            self.trouble = (
                f"model {version} is not used, because {error}: run `pincette model use "
                f"{version}` if it is still valid, or {alone}"
            )

    def _laid(self, model: StoredModel, without: Collection[str] = ()) -> ModelInUse:
        calibration = Calibration(
            values={name: one for name, one in model.values.items() if name not in without},
            sources={name: one for name, one in model.sources.items() if name not in without},
        )
        return ModelInUse(
            calibrated(self.file, calibration),
            self.digest,
            model.version,
            calibration,
            {name: one for name, one in model.uncertainties.items() if name not in without},
            {name: one for name, one in model.acceptances.items() if name not in without},
        )

    def use(self, version: int) -> None:
        """Use a version, or with 0 the rig file alone.

        Raises
        ------
        ConfigError
            If there is no such version, or its values are impossible for the rig.
        """
        with self._lock:
            chosen = (
                rig_file_alone(self.file)
                if version == RIG_FILE_ALONE
                else self._laid(self.files.read(version))
            )
            self._choose(chosen)

    def warnings(self, now: datetime) -> list[str]:
        """Return warnings of values in use that should be calibrated again; they block nothing."""
        used = self.in_use
        due = warnings(used.calibration.sources, used.acceptances, self._instruments.present, now)
        changed = [
            f"{words([change], used.version)}: the rig file's value is used, not the calibrated "
            f"one; calibrate again, or `pincette model use {used.version}`"
            for change in self.set_aside
        ]
        return [*due, *changed]

    def overdue(self, now: datetime) -> list[str]:
        """Return which calibrations in use have expired, in words."""
        used = self.in_use
        return warnings(used.calibration.sources, used.acceptances, {}, now)

    def due(self, calibration: str, now: datetime) -> list[Due]:
        """Return the reasons why a calibration in use should be repeated; empty if it is valid."""
        used = self.in_use
        for quantity, accepted in used.acceptances.items():
            if used.calibration.sources.get(quantity) == calibration:
                return due(calibration, accepted, self._instruments.present, now)
        return []

    def add(
        self,
        values: Mapping[str, Any],
        uncertainties: Mapping[str, float | None],
        source: str,
        measured_at: str = "",
    ) -> ModelInUse:
        """Add a new version, with values that replace those of the model in use, and use it.

        Parameters
        ----------
        measured_at
            Time at which the values were measured; empty for the present time.

        Raises
        ------
        ConfigError
            If the values are impossible for the rig.
        OSError
            If the file cannot be written; in this case nothing changes.
        """
        with self._lock:
            before, now = self.in_use, utc_now()
            values = merged(before.calibration.values, values, measured_at or now)
            acceptance = Acceptance(
                accepted_at=now,
                due_at=due_at(measured_at or now, self.file.calibration.valid_days),
                serial_numbers=self._instruments.at(measured_at or now),
            )
            calibration = Calibration(
                values={**before.calibration.values, **values},
                sources={**before.calibration.sources, **dict.fromkeys(values, source)},
            )
            model = StoredModel(
                version=max(self.files.numbers(), default=0) + 1,
                digest=calibration.digest,
                rig=self.file.rig.name,
                rig_file_digest=self.digest,
                basis=self._basis,
                made_at=now,
                values=calibration.values,
                sources=calibration.sources,
                uncertainties={**before.uncertainties, **uncertainties},
                acceptances={**before.acceptances, **dict.fromkeys(values, acceptance)},
                previous=before.digest,
            )
            laid = self._laid(model)
            self.files.write(model)
            self._choose(laid)
            return laid

    def _choose(self, chosen: ModelInUse) -> None:
        self._store.set_note(
            self._note, json.dumps({"version": chosen.version, "basis": self._basis})
        )
        self.in_use, self.trouble, self.changed, self.set_aside = chosen, "", [], []


def _noted(text: str) -> tuple[int, dict[str, Any]]:
    """Return the chosen version, and the rig file's values when it was chosen, from a note."""
    noted = json.loads(text)
    return noted["version"], noted["basis"]


class Instruments:
    """Serial numbers of a rig file, present and earlier ones; kept across restarts."""

    def __init__(self, store: Store, rig: str, present: Mapping[str, str]) -> None:
        self.present = dict(present)
        note = f"instruments: {rig}"
        noted = store.get_note(note)
        self._history: list[tuple[str, dict[str, str]]] = (
            [] if noted is None else [(since, had) for since, had in json.loads(noted)]
        )
        if not self._history or self._history[-1][1] != self.present:
            self._history = [*self._history, (utc_now(), self.present)][-KEPT_CHANGES:]
            store.set_note(note, json.dumps(self._history))

    def at(self, when: str) -> dict[str, str]:
        """Return the serial numbers at a time, by rig file table; unknown ones are left out."""
        for since, had in reversed(self._history):
            if since <= when:
                return had
        return {}
