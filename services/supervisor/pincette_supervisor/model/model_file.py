"""A model as a file: values that calibrations have found, over one rig file, in versions.

``NNNN-<digest>.json``, never changed once written; the next version names the one it follows.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field, ValidationError

from pincette.config import Calibration, ConfigError
from pincette.core.files import make_folder, replace_file
from pincette.core.validation_wording import refusal
from pincette_supervisor.plugin.model_in_use import FROZEN, Acceptance


class StoredModel(BaseModel):
    """One version."""

    model_config = FROZEN

    version: int = Field(ge=1)
    digest: str
    """Digest of the values."""
    rig: str
    rig_file_digest: str
    """Digest of the rig file with which the values were found."""
    basis: dict[str, Any] = Field(default_factory=dict)
    """Parts of that rig file on which the measurement depends."""
    made_at: str
    values: dict[str, Any]
    """Values by quantity; missing ones are the rig file's."""
    sources: dict[str, str]
    """Calibration that found each quantity."""
    uncertainties: dict[str, float | None]
    """By quantity, standard; null where there is none to state."""
    acceptances: dict[str, Acceptance] = Field(default_factory=dict)
    """Acceptance of each quantity."""
    previous: str
    """Digest of the model that was in use; empty: that of the rig file."""

    @property
    def calibration(self) -> Calibration:
        """As it travels; raises ConfigError where a quantity is unknown."""
        try:
            return Calibration(values=self.values, sources=self.sources)
        except ValidationError as error:
            raise ConfigError(refusal(error.errors()[0])) from error


@dataclass(frozen=True, slots=True)
class ModelFiles:
    """The versions of one rig, in a folder."""

    folder: Path

    def numbers(self) -> list[int]:
        """Return versions that there are, the oldest first."""
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
            Where there is none, or its file is not what was written.
        """
        path = self._paths().get(version)
        if path is None:
            raise ConfigError(f"no model {version}; there are {self.numbers() or 'none'}")
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
