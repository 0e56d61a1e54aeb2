"""The model in use over REST, its versions, and the reason why a version is not used."""

from typing import Annotated, Any, Literal

from pydantic import Field

from pincette.api import WHOLE, Model, example


class ModelQuantity(Model):
    """A quantity that calibrations can find, with its value in use."""

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
    """Value; null if the rig file has none."""
    unit: str
    source: str
    """``assumed``, or the calibration that found the value."""
    uncertainty: float | None
    """Standard uncertainty; null for assumed values."""
    accepted_at: str | None
    """Time of acceptance; null for assumed values."""
    due_at: str | None
    """Time at which the quantity should be measured again; null if there is none."""
    overdue: bool
    serial_numbers: dict[str, str]
    """Serial numbers of the instruments used for the measurement, if known, by table of the rig
    file.
    """


class ModelVersion(Model):
    """An accepted version of the model."""

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
    """Digest of the model that was in use before; empty if that was the rig file alone."""
    trouble: str
    """Reason why a person must confirm the version before it is used; empty if no confirmation is
    needed.
    """


class ModelChange(Model):
    """A key of the rig file whose value has changed since the model in use was chosen."""

    model_config = example(key="sensor.driver", before="keyence_lkg", now="nidaqmx")

    key: str
    before: Any
    now: Any


class ModelView(Model):
    """The model in use and all versions."""

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
    """Version of the model; 0: the rig file alone."""
    digest: str
    rig_file_digest: str
    trouble: str
    """Reason why the model that was in use before a restart is not in use now; empty if it is."""
    changed: list[ModelChange]
    """Values that have changed since the model was measured; because of them it is not in use."""
    set_aside: list[ModelChange]
    """Values that were changed in the rig file after the calibration, and that replace calibrated
    values.
    """
    quantities: list[ModelQuantity]
    versions: list[ModelVersion]


class ModelAction(Model):
    """Request to use a version of the model; 0 is the rig file alone."""

    model_config = example(type="use", version=1)

    type: Literal["use"]
    version: Annotated[int, Field(ge=0, le=9999), WHOLE]
