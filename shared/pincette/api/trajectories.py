"""Trajectories over REST: plans that were checked, predicted and stored under their digest."""

from typing import Any

from pydantic import Field

from pincette.api import Model, example
from pincette.api.pairs import PairPlan
from pincette.api.plans import MotionPlan, Plan
from pincette.api.requests import Label, LabelName, OnAbort, OnStop

REQUEST: dict[str, Any] = {"kind": "grip", "force_mN": 20.0}
"""Request used in the examples of several models."""


class TrajectorySummary(Model):
    """Input of a trajectory, and whether it is still valid."""

    model_config = example(
        digest="4be9f7a3c2d18e5f6a70",
        kind="grip",
        rig="demo",
        request=REQUEST,
        created_at="2026-03-01T12:00:00.000Z",
        stale=[],
    )

    digest: str
    """Digest of the request, the rig file and the model."""
    kind: str
    rig: str
    request: dict[str, Any]
    created_at: str
    stale: list[str]
    """Changes since the plan was stored, as text; empty if a job can still be created from it."""


class Trajectory(TrajectorySummary):
    """A stored plan with its prediction."""

    model_config = example(
        digest="4be9f7a3c2d18e5f6a70",
        kind="grip",
        rig="demo",
        request=REQUEST,
        created_at="2026-03-01T12:00:00.000Z",
        stale=[],
        values={"force_mN": 20.0, "hold_s": 4.0},
        period_s=0.02,
        samples=771,
        plan=None,
    )

    values: dict[str, Any]
    """The request completed from the rig file; empty if ``plan`` is null."""
    period_s: float
    """Time between two samples."""
    samples: int
    plan: Plan | PairPlan | MotionPlan | None
    """The plan; null if the rig file or the model with which it was made no longer exists."""


class TrajectoryList(Model):
    """Trajectories, newest first."""

    model_config = example(trajectories=[], next=None)

    trajectories: list[TrajectorySummary]
    next: str | None = None
    """Value of ``before`` for the next page; null at the end."""


class TrajectoryStart(Model):
    """Options for the beginning and the end of a job that is created from a trajectory."""

    model_config = example(autostart=True, labels={"part": "bead 12"})

    autostart: bool = False
    """True if the job starts as soon as it is ready, without the action ``start``."""
    queue: bool = False
    """True to wait while another job uses the rig; False to have the request rejected in that
    case."""
    labels: dict[LabelName, Label] = Field(default_factory=dict, max_length=16)
    on_stop: OnStop | None = None
    """Action on a held part when the job is stopped; only for a grip or a track."""
    on_abort: OnAbort | None = None
    """Action on a held part when the job is aborted; only for a grip or a track."""


class SampleColumn(Model):
    """A column of samples."""

    model_config = example(name="x_um", unit="µm", meaning="position of the tip, predicted")

    name: str
    unit: str
    meaning: str


class TrajectorySamples(Model):
    """All samples of a trajectory, one per control period."""

    model_config = example(
        digest="4be9f7a3c2d18e5f6a70",
        period_s=0.02,
        cut="",
        columns=[{"name": "t_s", "unit": "s", "meaning": "time since the start"}],
        samples={"t_s": [0.0, 0.02]},
    )

    digest: str
    period_s: float
    cut: str
    """Reason why the samples end before the plan does; empty if they reach its end."""
    columns: list[SampleColumn]
    samples: dict[str, list[float] | list[str]]
    """Columns of equal length, by name."""
