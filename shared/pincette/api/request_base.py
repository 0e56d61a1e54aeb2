"""What all requests for a job have in common: kinds of numbers, and when a job begins."""

from typing import Annotated

from pydantic import BaseModel, Field

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Duration = Annotated[float, Field(gt=0, le=3600)]
Speed = Annotated[float, Field(ge=0.1, le=1000)]
Label = Annotated[str, Field(max_length=200)]
LabelName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,40}$")]


class StartRequest(BaseModel):
    """What every job may say."""

    autostart: bool = False
    """Begin as soon as the job is ready, without the action ``start``."""
    dry_run: bool = False
    """Plan and predict only; no job is made."""
    rig: str | None = Field(default=None, max_length=40)
    """Name of the rig; may be left out where there is one."""
    labels: dict[LabelName, Label] = Field(default_factory=dict, max_length=16)
