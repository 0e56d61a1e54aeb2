"""The course of a rig over hours, as its records have it."""

from typing import Any

from pydantic import Field

from pincette.api import Model, example
from pincette.api.states import JobState

Column = list[float | None]
JOB: dict[str, Any] = {
    "id": "20260102-101500-1a2b3c",
    "kind": "grip",
    "state": "succeeded",
    "from_s": 1767348900.0,
    "to_s": 1767348912.0,
    "recorded": True,
}


class HistoryJob(Model):
    """A job that has run in the time that was asked for."""

    model_config = example(**JOB)

    id: str
    kind: str
    state: JobState
    from_s: float
    to_s: float | None
    """Null while it runs."""
    recorded: bool
    """Whether its samples are among the points; those of a job that runs come with its end."""


class History(Model):
    """Smallest and largest values of each stretch of time, in columns of one length.

    Times are seconds since 1970, UTC. Where no record is, there is no point; a column holds null
    where the record has no value. ``…_error_…`` is the measured or estimated value less its
    reference.
    """

    model_config = example(
        rig="demo",
        from_s=1767348000.0,
        to_s=1767351600.0,
        step_s=6.0,
        at_s=[1767348903.0],
        low={"x_um": [39.8], "force_mN": [19.6]},
        high={"x_um": [39.9], "force_mN": [20.3]},
        jobs=[JOB],
        left_out=0,
    )

    rig: str
    from_s: float
    to_s: float
    step_s: float
    """Length of a stretch."""
    at_s: list[float]
    """Middle of each stretch that has samples."""
    low: dict[str, Column]
    high: dict[str, Column]
    jobs: list[HistoryJob] = Field(default_factory=list[HistoryJob])
    """The oldest first."""
    left_out: int
    """Older jobs of that time that are too many to be read."""
