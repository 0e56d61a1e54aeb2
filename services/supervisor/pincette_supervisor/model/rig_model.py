"""Which model is in use: the rig file, and over it the version of a model that was accepted."""

import json
import threading
from collections.abc import Collection, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from pincette.api.models import ModelChange
from pincette.config import Calibration, ConfigError, RigFile, calibrated
from pincette_supervisor.journal.store import Store, utc_now
from pincette_supervisor.model.basis import basis, changes, doubtful, words
from pincette_supervisor.model.model_file import Acceptance, ModelFiles, StoredModel
from pincette_supervisor.model.model_in_use import RIG_FILE_ALONE, ModelInUse, rig_file_alone
from pincette_supervisor.model.residuals import merged
from pincette_supervisor.model.upkeep import Due, due, due_at, warnings

KEPT_CHANGES = 100
"""Changes of instruments that are kept; older ones concern no value in use."""


class RigModel:
    """Which model a rig is used with; kept beyond a restart.

    A model that was measured with other instruments or another arm (``basis``) is not laid over the
    rig file without a person's word: until then nothing is in use but the rig file, and ``trouble``
    says why. A value that a person has changed in the rig file since is not replaced.
    """

    def __init__(self, rig_file: RigFile, folder: Path, store: Store) -> None:
        self.file = rig_file
        self.trouble = ""
        self.changed: list[ModelChange] = []
        """Why no model is in use."""
        self.set_aside: list[ModelChange] = []
        """Values of the model that the rig file replaces, since a person has changed them there."""
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
        """The rig file with the model in use."""
        return self.in_use.rig

    @property
    def digest(self) -> str:
        """Of the rig file, which all programs must agree on."""
        return self.in_use.rig_file_digest

    def _take_up(self) -> None:
        """Go on with the model that was in use before a restart."""
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
                f"model {version} is unused, because {error}: put the file back as it was and run "
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
                f"model {version} is unused, because {error}: `pincette model use {version}` where "
                f"it still holds, or {alone}"
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
            Where there is no such version, or it makes an impossible rig.
        """
        with self._lock:
            chosen = (
                rig_file_alone(self.file)
                if version == RIG_FILE_ALONE
                else self._laid(self.files.read(version))
            )
            self._choose(chosen)

    def warnings(self, now: datetime) -> list[str]:
        """What in use should be calibrated again, in words; nothing is refused for it."""
        used = self.in_use
        due = warnings(used.calibration.sources, used.acceptances, self._instruments.present, now)
        changed = [
            f"{words([change], used.version)}: the rig file's value is used, not the calibrated "
            f"one; calibrate again, or `pincette model use {used.version}`"
            for change in self.set_aside
        ]
        return [*due, *changed]

    def due(self, calibration: str, now: datetime) -> list[Due]:
        """Why a calibration in use should be made again; nothing where it is still good."""
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
        """Lay values over the model in use as a new version, and use it.

        Parameters
        ----------
        measured_at
            When they were measured; empty: just now.

        Raises
        ------
        ConfigError
            Where they make an impossible rig.
        OSError
            Where the file cannot be written; nothing has changed then.
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
    """The version that was chosen, and what the rig file had then."""
    noted = json.loads(text)
    return noted["version"], noted["basis"]


class Instruments:
    """The serial numbers of a rig file, and those that were in it before; kept beyond a restart."""

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
        """Serial numbers at a time, by table of the rig file; what is not known is not there."""
        for since, had in reversed(self._history):
            if since <= when:
                return had
        return {}
