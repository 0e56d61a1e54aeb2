"""Measured history of a rig over hours, read from its records."""

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
    """A job that ran during the requested time."""

    model_config = example(**JOB)

    id: str
    kind: str
    state: JobState
    from_s: float
    to_s: float | None
    """End of the job; null while it runs."""
    recorded: bool
    """True if the points include the samples of the job. A running job's samples are added when it
    ends.
    """


class History(Model):
    """Smallest and largest values in each interval of time, as columns of equal length.

    Times are seconds since 1970, UTC. An interval without a record has no point; a column holds
    null for a value that the record lacks. ``…_error_…`` is the measured or estimated value minus
    its reference. ``second_…`` belongs to the second arm; records of one arm have no such column.
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
    """Length of an interval, in s."""
    at_s: list[float]
    """Centre of each interval that has samples."""
    low: dict[str, Column]
    high: dict[str, Column]
    jobs: list[HistoryJob] = Field(default_factory=list[HistoryJob])
    """Jobs, oldest first."""
    left_out: int
    """Number of older jobs in the requested time that were omitted because there were too many."""
