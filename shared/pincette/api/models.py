"""The model in use over REST, its versions, and why one is not used."""

from typing import Annotated, Any, Literal

from pydantic import Field

from pincette.api import WHOLE, Model, example


class ModelQuantity(Model):
    """A quantity that calibrations can find, as it is in use."""

    model_config = example(
        quantity="model.compliance_um_per_mN",
        value=0.4583,
        unit="µm/mN",
        source="20260301-120000-1f0c",
        uncertainty=0.0011,
        accepted_at="2026-03-01T12:02:00.000Z",
        due_at="2026-08-28T12:01:10.000Z",
        overdue=False,
        serial_numbers={"sensor": "1540122", "output": "A-0311"},
    )

    quantity: str
    value: Any
    """Null where the rig file has none."""
    unit: str
    source: str
    """``assumed``, or the calibration it comes from."""
    uncertainty: float | None
    """Standard; null of what is assumed."""
    accepted_at: str | None
    """Null of what is assumed."""
    due_at: str | None
    """When it is to be measured again; null: never by itself."""
    overdue: bool
    serial_numbers: dict[str, str]
    """Of the instruments it was measured with, by table of the rig file; those that are known."""


class ModelVersion(Model):
    """A version that was accepted."""

    model_config = example(
        version=1,
        digest="3f2a9d1c0b7e6655",
        made_at="2026-03-01T12:02:00.000Z",
        quantities=["model.compliance_um_per_mN"],
        previous="",
        trouble="",
    )

    version: int
    digest: str
    made_at: str
    quantities: list[str]
    previous: str
    """Digest of the model that was in use before; empty: that of the rig file."""
    trouble: str
    """Why it is not used without a person's word; empty where it can be."""


class ModelChange(Model):
    """A key of the rig file with another value than when the model was chosen."""

    model_config = example(key="sensor.driver", before="keyence_lkg", now="nidaqmx")

    key: str
    before: Any
    now: Any


class ModelView(Model):
    """The model in use, and the versions there are."""

    model_config = example(
        rig="demo",
        version=1,
        digest="3f2a9d1c0b7e6655",
        rig_file_digest="9f31c2a4550b7e66",
        trouble="",
        changed=[],
        set_aside=[],
        quantities=[],
        versions=[],
    )

    rig: str
    version: int
    """0: the rig file alone."""
    digest: str
    rig_file_digest: str
    trouble: str
    """Why the model of before a restart is not in use; empty where nothing is the matter."""
    changed: list[ModelChange]
    """What the model was measured with and is different now, so that it is not in use."""
    set_aside: list[ModelChange]
    """Values changed in the rig file since, which are used in place of the calibrated ones."""
    quantities: list[ModelQuantity]
    versions: list[ModelVersion]


class ModelAction(Model):
    """Use a version, or with 0 the rig file alone."""

    model_config = example(type="use", version=1)

    type: Literal["use"]
    version: Annotated[int, Field(ge=0, le=9999), WHOLE]
