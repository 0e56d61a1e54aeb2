"""What programs have learned across their cycles, over REST."""

from typing import Any

from pydantic import Field

from pincette.api import Model, example


class LearnedProgram(Model):
    """Corrections that one program has learned; every job of the same program begins with them."""

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
    """Names the program, with its law and the free response behind it."""
    job: str
    """That learned last."""
    learned_at: str
    """UTC."""
    motion: dict[str, Any]
    """What the program does."""
    cycles: int
    """That were learned from."""
    over: bool
    """Whether no more is learned."""
    values_um: list[float]
    """What is added to x_r, tick by tick of a cycle."""
    errors_um: list[float]
    """R.m.s. of x less x_r of each cycle that was learned from, in order."""


class LearnedList(Model):
    """What the programs of a rig have learned, the newest first."""

    model_config = example(rig="demo", programs=[])

    rig: str
    programs: list[LearnedProgram]
    next: str | None = None
    """Program to pass as ``before`` for the following page; null at the end."""


class Erased(Model):
    """How many programs have forgotten what they had learned."""

    model_config = example(rig="demo", erased=1)

    rig: str
    erased: int = Field(ge=0)
