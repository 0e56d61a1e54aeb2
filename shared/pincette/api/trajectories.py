"""Trajectories over REST: plans that were checked, predicted and kept by their digest."""

from typing import Any

from pydantic import Field

from pincette.api import Model, example
from pincette.api.pairs import PairPlan
from pincette.api.plans import MotionPlan, Plan
from pincette.api.requests import Label, LabelName, OnAbort, OnStop

REQUEST: dict[str, Any] = {"kind": "grip", "force_mN": 20.0}
"""Part of the examples."""


class TrajectorySummary(Model):
    """What a trajectory was made of, and whether that still holds."""

    model_config = example(
        digest="4be9f7a3c2d18e5f6a70",
        kind="grip",
        rig="demo",
        request=REQUEST,
        created_at="2026-03-01T12:00:00.000Z",
        stale=[],
    )

    digest: str
    """Of the request, the rig file and the model."""
    kind: str
    rig: str
    request: dict[str, Any]
    created_at: str
    stale: list[str]
    """What has changed since, in words; empty where a job can be made of it."""


class Trajectory(TrajectorySummary):
    """A plan with what it predicts."""

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
    """The request completed by the rig file; empty where ``plan`` is null."""
    period_s: float
    """From sample to sample."""
    samples: int
    plan: Plan | PairPlan | MotionPlan | None
    """Null where rig file or model that it was made with are not there any more."""


class TrajectoryList(Model):
    """Trajectories, the newest first."""

    model_config = example(trajectories=[], next=None)

    trajectories: list[TrajectorySummary]
    next: str | None = None
    """Value of ``before`` for the trajectories that follow; null where there are no more."""


class TrajectoryStart(Model):
    """How a job that is made of a trajectory begins and ends."""

    model_config = example(autostart=True, labels={"part": "bead 12"})

    autostart: bool = False
    """Begin as soon as the job is ready, without the action ``start``."""
    queue: bool = False
    """Wait for the rig while another job has it, instead of being refused."""
    labels: dict[LabelName, Label] = Field(default_factory=dict, max_length=16)
    on_stop: OnStop | None = None
    """Of a grip or a track: what a stop does with a held part."""
    on_abort: OnAbort | None = None
    """Of a grip or a track: what an abort does with a held part."""


class SampleColumn(Model):
    """A column of samples."""

    model_config = example(name="x_um", unit="µm", meaning="position of the tip, predicted")

    name: str
    unit: str
    meaning: str


class TrajectorySamples(Model):
    """All samples of a trajectory, one each control period."""

    model_config = example(
        digest="4be9f7a3c2d18e5f6a70",
        period_s=0.02,
        cut="",
        columns=[{"name": "t_s", "unit": "s", "meaning": "time since the begin"}],
        samples={"t_s": [0.0, 0.02]},
    )

    digest: str
    period_s: float
    cut: str
    """Why they do not go to the end of the plan; empty where they do."""
    columns: list[SampleColumn]
    samples: dict[str, list[float] | list[str]]
    """By the name of the column; lists of one length."""
