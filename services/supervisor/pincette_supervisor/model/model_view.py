"""The model in use, put together for REST."""

from datetime import UTC, datetime
from typing import Any

from pincette.api.models import ModelQuantity, ModelVersion, ModelView
from pincette.config import ConfigError
from pincette_supervisor.model.basis import basis, changes, doubtful, words
from pincette_supervisor.model.model_in_use import ModelInUse
from pincette_supervisor.model.quantities import ASSUMED, UNITS, values_of
from pincette_supervisor.model.rig_model import RigModel
from pincette_supervisor.model.upkeep import overdue
from pincette_supervisor.problems import ProblemError, not_found


def model_view(model: RigModel) -> ModelView:
    """What is in use, quantity by quantity, and the versions there are."""
    used, now = model.in_use, datetime.now(UTC)
    return ModelView(
        rig=model.file.rig.name,
        version=used.version,
        digest=used.digest,
        rig_file_digest=model.digest,
        trouble=model.trouble,
        changed=model.changed,
        set_aside=model.set_aside,
        quantities=[
            _quantity(used, quantity, value, now) for quantity, value in values_of(used.rig).items()
        ],
        versions=[_version(model, number) for number in model.files.numbers()],
    )


def _quantity(used: ModelInUse, quantity: str, value: Any, now: datetime) -> ModelQuantity:
    accepted = used.acceptances.get(quantity)
    return ModelQuantity(
        quantity=quantity,
        value=value,
        unit=UNITS[quantity],
        source=used.calibration.sources.get(quantity, ASSUMED),
        uncertainty=used.uncertainties.get(quantity),
        accepted_at=None if accepted is None else accepted.accepted_at,
        due_at=None if accepted is None else accepted.due_at,
        overdue=accepted is not None and overdue(accepted, now),
        serial_numbers={} if accepted is None else accepted.serial_numbers,
    )


def _version(model: RigModel, number: int) -> ModelVersion:
    try:
        stored = model.files.read(number)
    except ConfigError as error:
        return ModelVersion(
            version=number, digest="", made_at="", quantities=[], previous="", trouble=str(error)
        )
    other = doubtful(changes(stored.basis, basis(model.file)))
    return ModelVersion(
        version=number,
        digest=stored.digest,
        made_at=stored.made_at,
        quantities=sorted(stored.values),
        previous=stored.previous,
        trouble=words(other, number) if other else "",
    )


def use_model(model: RigModel, version: int) -> ModelView:
    """Go over to a version; raises ProblemError where it cannot be used."""
    there = model.files.numbers()
    if version and version not in there:
        raise not_found("version of the model", str(version), [str(one) for one in (0, *there)])
    try:
        model.use(version)
    except ConfigError as error:
        raise ProblemError(
            422, "impossible-model", "The model cannot be used", str(error)
        ) from error
    return model_view(model)
