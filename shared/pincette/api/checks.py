"""Faults and checks of a rig, and the health probes of a supervisor."""

from typing import Literal

from pincette.api import Model, example
from pincette.control.vocabulary import FaultCode


class FaultView(Model):
    """A fault. ``code`` and ``values`` are for programs, ``text`` is for people."""

    model_config = example(
        code="no_command",
        values={"silent_s": 0.062, "limit_s": 0.05},
        text="no command for 62 ms, limit 50 ms",
    )

    code: FaultCode
    values: dict[str, float | None]
    """Numbers of the fault by name. Names end with the unit. A number that is not finite is
    null.
    """
    text: str


class Check(Model):
    """One check of a rig or a supervisor, with its result."""

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
    """True if the rig is ready only when this check passes. Other checks are advice for people."""
    value: float | str | None
    limit: float | str | None
    unit: str
    age_s: float | None
    """Time since the check was made; null if it is not known."""
    words: str
    """Result of the check, as text for people."""


class Alive(Model):
    """State of the supervisor process itself: whether it is running properly."""

    model_config = example(status="alive", checks=[])

    status: Literal["alive"] = "alive"
    checks: list[Check]


class Readiness(Model):
    """Readiness of the supervisor to serve its rigs: its own checks and those of each rig."""

    model_config = example(status="not ready", reasons=["demo: sensor: …"], checks=[], rigs={})

    status: Literal["ready", "not ready"]
    reasons: list[str]
    """Reasons why a rig is not ready, each with the name of the rig."""
    checks: list[Check]
    """Checks of the supervisor itself."""
    rigs: dict[str, list[Check]]
