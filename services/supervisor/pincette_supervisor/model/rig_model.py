"""Which model is in use: the rig file, and over it the version of a model that was accepted."""

import json
import threading
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from pincette.config import Calibration, ConfigError, RigFile, calibrated
from pincette_supervisor.journal.store import Store, utc_now
from pincette_supervisor.model.instruments import Instruments
from pincette_supervisor.model.model_file import Acceptance, ModelFiles, StoredModel
from pincette_supervisor.model.model_in_use import RIG_FILE_ALONE, ModelInUse, rig_file_alone
from pincette_supervisor.model.upkeep import due_at, warnings


class RigModel:
    """Which model a rig is used with; kept beyond a restart.

    A model that was chosen over another rig file is not laid over this one without a person's
    word: until then nothing is in use but the rig file, and ``trouble`` says why.
    """

    def __init__(self, rig_file: RigFile, folder: Path, store: Store) -> None:
        self.file = rig_file
        self.trouble = ""
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
        noted = self._store.noted(self._note)
        if noted is None:
            return
        version, digest = json.loads(noted)
        if version == RIG_FILE_ALONE:
            return
        try:
            if digest != self.digest:
                raise ConfigError(
                    f"model {version} was in use with rig file {digest}, this one is {self.digest}"
                )
            self.in_use = self._laid(self.files.read(version))
        except ConfigError as error:
            name = self.file.rig.name
            self.trouble = (
                f"{error}; nothing but the rig file is in use: POST /api/v1/rigs/{name}/model/"
                f"actions use version {version} where it still holds, or version 0"
            )

    def _laid(self, model: StoredModel) -> ModelInUse:
        calibration = model.calibration
        return ModelInUse(
            calibrated(self.file, calibration),
            self.digest,
            model.version,
            calibration,
            model.uncertainties,
            model.acceptances,
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
        return warnings(used.calibration.sources, used.acceptances, self._instruments.present, now)

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
        self._store.note(self._note, json.dumps([chosen.version, self.digest]))
        self.in_use, self.trouble = chosen, ""
