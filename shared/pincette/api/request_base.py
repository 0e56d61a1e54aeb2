"""What all requests for a job have in common: kinds of numbers, when a job begins, how it ends."""

from typing import Annotated, Literal

from pydantic import BaseModel, Field

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Duration = Annotated[float, Field(gt=0, le=3600)]
Speed = Annotated[float, Field(ge=0.1, le=1000)]
Label = Annotated[str, Field(max_length=200)]
LabelName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,40}$")]
RecipeName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,40}(@[1-9][0-9]{0,5})?$")]
OnStop = Literal["hold", "release", "retract"]
OnAbort = Literal["freeze", "ramp"]


class StartRequest(BaseModel):
    """What every job may say."""

    autostart: bool = False
    """Begin as soon as the job is ready, without the action ``start``."""
    dry_run: bool = False
    """Plan and predict only; no job is made."""
    rig: str | None = Field(default=None, max_length=40)
    """Name of the rig; may be left out where there is one."""
    labels: dict[LabelName, Label] = Field(default_factory=dict, max_length=16)
    queue: bool = False
    """Wait for the rig while another job has it, instead of being refused."""
    recipe: RecipeName | None = None
    """Name of a recipe, or name@version, which completes what the request leaves out."""


class PolicyRequest(StartRequest):
    """What every job that holds a part may say of its end."""

    on_stop: OnStop = "hold"
    """What a stop does with a held part: keep it, let it go, or let it go and retreat."""
    on_abort: OnAbort = "freeze"
    """What an abort does with a held part: keep it for the rig file's time, or ramp at once."""
