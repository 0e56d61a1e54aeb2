"""Commands to a simulated rig over REST: manual actions at the bench, and faults."""

from typing import Annotated

from pydantic import Field

from pincette.api import Model, example


class SimulationCommand(Model):
    """One command to a simulated rig; ``GET`` lists the operations."""

    model_config = example(target="sensor", what="stuck", value=None, after_s=0.0, for_s=1.0)

    target: Annotated[str, Field(min_length=1, max_length=40)]
    what: Annotated[str, Field(min_length=1, max_length=40)]
    value: Annotated[float, Field(allow_inf_nan=False)] | None = None
    """Value in the unit of the operation. Null if the operation has no value, or to use its
    default.
    """
    after_s: Annotated[float, Field(ge=0.0, le=86_400.0)] = 0.0
    """Delay until the command takes effect, in the rig's own time."""
    for_s: Annotated[float, Field(gt=0.0, le=86_400.0)] | None = None
    """Duration of a fault; null means until ``heal``."""


class SimulationOperation(Model):
    """One operation on a simulated rig."""

    model_config = example(
        target="sensor",
        what="slow",
        meaning="answers late",
        quantity="s",
        least=0.0,
        most=5.0,
        default=None,
        lasts=True,
    )

    target: str
    what: str
    meaning: str
    quantity: str
    """Quantity of the value, with its unit; empty if the operation has no value."""
    least: float
    most: float
    default: float | None
    """Default of the value. If it is null and the operation has a value, the value must be
    given.
    """
    lasts: bool
    """True if the operation is a fault, which has a duration and can be healed."""


class SimulationOperationList(Model):
    """All operations on a simulated rig."""

    model_config = example(operations=[])

    operations: list[SimulationOperation]
