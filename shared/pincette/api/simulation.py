"""Commands to a simulated rig over REST: what a person does at its bench, and faults."""

from typing import Annotated

from pydantic import Field

from pincette.api import Model, example


class SimulationCommand(Model):
    """One command to a simulated rig; ``GET`` lists what there is."""

    model_config = example(target="sensor", what="stuck", value=None, after_s=0.0, for_s=1.0)

    target: Annotated[str, Field(min_length=1, max_length=40)]
    what: Annotated[str, Field(min_length=1, max_length=40)]
    value: Annotated[float, Field(allow_inf_nan=False)] | None = None
    """In the unit of the operation; null where it takes none, or for its default."""
    after_s: Annotated[float, Field(ge=0.0, le=86_400.0)] = 0.0
    """From now on, in the rig's own time."""
    for_s: Annotated[float, Field(gt=0.0, le=86_400.0)] | None = None
    """How long a fault lasts; null: until ``heal``."""


class SimulationOperation(Model):
    """One thing that can be done to a simulated rig."""

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
    """What its value is, with the unit; empty: it takes none."""
    least: float
    most: float
    default: float | None
    """Null: a value must be given, where it takes one."""
    lasts: bool
    """Whether it is a fault, which lasts for a time and can be healed."""


class SimulationOperationList(Model):
    """All that can be done to a simulated rig."""

    model_config = example(operations=[])

    operations: list[SimulationOperation]
