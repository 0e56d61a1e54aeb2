"""How punctual the programs of a loop have been, over REST and in a record."""

from pydantic import BaseModel

from pincette.api.job_models import example

SPREAD = {"count": 1000, "p50_s": 9.4e-05, "p99_s": 3.1e-4, "p999_s": 5.5e-4, "max_s": 7.2e-4}
TIMED = {
    "program": "estimator",
    "epoch": 81985529216486895,
    "seq": 999,
    "missed": 0,
    "lateness": SPREAD,
    "age": SPREAD,
    "execution": SPREAD,
}


class Spread(BaseModel):
    """How long something took; a quantile is up to 1/32 too long, and never too short."""

    model_config = example(**SPREAD)

    count: int
    p50_s: float | None
    """None where nothing was counted."""
    p99_s: float | None
    p999_s: float | None
    max_s: float | None


class ProgramTiming(BaseModel):
    """How punctual a program of the loop has been since its epoch began."""

    model_config = example(**TIMED)

    program: str
    epoch: int
    seq: int
    """The newest sample that is counted."""
    missed: int
    """Samples and points of the grid that were skipped."""
    lateness: Spread
    """Of its wake-ups against its own grid, or else of its samples' arrival against theirs."""
    age: Spread
    """From the first arrival of a sample's number to the step with what it acts on."""
    execution: Spread
    """Of its steps, until all was told; instruments included."""


class LoopTiming(BaseModel):
    """How punctual the programs of a loop have been; in lockstep nobody counts."""

    model_config = example(programs=[TIMED], silent={})

    programs: list[ProgramTiming]
    silent: dict[str, str] = {}
    """Programs that have not said, each with why."""
