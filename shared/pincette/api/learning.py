"""Corrections that motion programs have learned over their cycles, over REST."""

from typing import Any

from pydantic import Field

from pincette.api import Model, example


class LearnedProgram(Model):
    """Corrections that one motion program has learned. Every job with the same program starts with
    them.
    """

    model_config = example(
        program="5f0c1e2a9b7d4c3e",
        job="20260301-120000-1f0c",
        learned_at="2026-03-01T12:01:10.000Z",
        motion={"shape": "sinusoid", "frequency_hz": 5.0, "force_pp_mN": 18.0},
        cycles=2,
        over=False,
        values_um=[0.02, -0.01],
        errors_um=[0.12, 0.07],
    )

    program: str
    """Digest of the motion program, its law and the free response."""
    job: str
    """Identifier of the last job that learned."""
    learned_at: str
    """Time of the last change of the corrections, in UTC."""
    motion: dict[str, Any]
    """Description of the program's motion."""
    cycles: int
    """Number of cycles from which the corrections were learned."""
    over: bool
    """True if learning has ended."""
    values_um: list[float]
    """Correction that is added to x_r, at each tick of a cycle."""
    errors_um: list[float]
    """Root mean square of x minus x_r in each cycle that was used for learning, in order."""


class LearnedList(Model):
    """Learned programs of a rig, newest first."""

    model_config = example(rig="demo", programs=[])

    rig: str
    programs: list[LearnedProgram]
    next: str | None = None
    """Value of ``before`` for the next page; null at the end."""


class Erased(Model):
    """Number of programs whose corrections were deleted."""

    model_config = example(rig="demo", erased=1)

    rig: str
    erased: int = Field(ge=0)
