"""Faults and checks of a rig, and the probes of a supervisor, over REST."""

from typing import Literal

from pincette.api import Model, example
from pincette.control.vocabulary import FaultCode


class FaultView(Model):
    """What is wrong: go by ``code`` and ``values``, and show ``text``."""

    model_config = example(
        code="no_command",
        values={"silent_s": 0.062, "limit_s": 0.05},
        text="no command for 62 ms, limit 50 ms",
    )

    code: FaultCode
    values: dict[str, float | None]
    """By name, which ends in the unit; null where the number is not finite."""
    text: str


class Check(Model):
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


class Alive(Model):
    """Whether the supervisor itself is at work."""

    model_config = example(status="alive", checks=[])

    status: Literal["alive"] = "alive"
    checks: list[Check]


class Readiness(Model):
    """Whether the supervisor can serve a rig: its own checks, and those of each rig."""

    model_config = example(status="not ready", reasons=["demo: sensor: …"], checks=[], rigs={})

    status: Literal["ready", "not ready"]
    reasons: list[str]
    """Of what is needed and missing, each with its rig."""
    checks: list[Check]
    """Of the supervisor itself."""
    rigs: dict[str, list[Check]]
