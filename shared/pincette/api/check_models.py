"""Named checks: what must hold for a rig to be relied on, each with its value and its limit."""

from typing import Literal

from pydantic import BaseModel

from pincette.api.job_models import example


class Check(BaseModel):
    """Something that was looked at."""

    model_config = example(
        name="sensor.age",
        ok=False,
        needed=True,
        value=0.412,
        limit=0.2,
        unit="s",
        age_s=0.0,
        words="sensor silent for 412 ms, limit 200 ms",
    )

    name: str
    ok: bool
    needed: bool
    """Whether a rig without it is not ready; the others are for a person to see to."""
    value: float | str | None
    limit: float | str | None
    unit: str
    age_s: float | None
    """How long ago it was looked at; null where that is not known."""
    words: str
    """What is found, in words."""


class Alive(BaseModel):
    """Whether the supervisor itself is at work."""

    model_config = example(status="alive", checks=[])

    status: Literal["alive"] = "alive"
    checks: list[Check]


class Readiness(BaseModel):
    """Whether the supervisor can serve a rig: its own checks, and those of each rig."""

    model_config = example(status="not ready", reasons=["demo: sensor: …"], checks=[], rigs={})

    status: Literal["ready", "not ready"]
    reasons: list[str]
    """Of what is needed and missing, each with its rig."""
    checks: list[Check]
    """Of the supervisor itself."""
    rigs: dict[str, list[Check]]
