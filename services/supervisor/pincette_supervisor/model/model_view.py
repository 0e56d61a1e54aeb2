"""The model in use, put together for REST."""

from pincette.api.proposal_models import ModelQuantity, ModelVersion, ModelView
from pincette.config import ConfigError
from pincette_supervisor.model.quantities import ASSUMED, UNITS, values_of
from pincette_supervisor.model.rig_model import RigModel
from pincette_supervisor.problems import ProblemError


def model_view(model: RigModel) -> ModelView:
    """What is in use, quantity by quantity, and the versions there are."""
    used = model.in_use
    sources, uncertainties = used.calibration.sources, used.uncertainties
    return ModelView(
        rig=model.file.rig.name,
        version=used.version,
        digest=used.digest,
        rig_file_digest=model.digest,
        trouble=model.trouble,
        quantities=[
            ModelQuantity(
                quantity=quantity,
                value=value,
                unit=UNITS[quantity],
                source=sources.get(quantity, ASSUMED),
                uncertainty=uncertainties.get(quantity),
            )
            for quantity, value in values_of(used.rig).items()
        ],
        versions=[_version(model, number) for number in model.files.numbers()],
    )


def _version(model: RigModel, number: int) -> ModelVersion:
    try:
        stored = model.files.read(number)
    except ConfigError as error:
        return ModelVersion(
            version=number, digest="", made_at="", quantities=[], previous="", trouble=str(error)
        )
    other = stored.rig_file_digest != model.digest
    return ModelVersion(
        version=number,
        digest=stored.digest,
        made_at=stored.made_at,
        quantities=sorted(stored.values),
        previous=stored.previous,
        trouble=f"made over rig file {stored.rig_file_digest}" if other else "",
    )


def use_model(model: RigModel, version: int) -> ModelView:
    """Go over to a version; raises ProblemError where it cannot be used."""
    try:
        model.use(version)
    except ConfigError as error:
        raise ProblemError(
            422, "impossible-model", "The model cannot be used", str(error)
        ) from error
    return model_view(model)
