"""Predictions are computed one at a time, stored, and requested before a job is accepted."""

import threading
from functools import cache
from typing import Any

import pytest
from pydantic import TypeAdapter

from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning import dry_run, prediction
from pincette_supervisor.planning.dry_run import DryRun, stated_instruments
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.planning.prediction import PredictionCache
from pincette_supervisor.plugin import Planned, Present
from pincette_supervisor.problems import ProblemError
from tests.support.rigs import at_own_ports, demo_rig

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)


@cache
def straight() -> RigFile:
    """The demo rig without hysteresis and creep."""
    return demo_rig({"model": {"free_response": None}}, time="lockstep")


def plan(rig: RigFile, present: Present | None = None, **wishes: Any) -> Planned:
    return plan_job(REQUEST.validate_python(wishes), rig, present)


def nothing() -> DryRun:
    return DryRun(dry_run.Samples(), "gripped", "", stated_instruments(straight()))


def test_a_plan_is_checked_before_its_job_is_created() -> None:
    rig, teller = at_own_ports(straight(), {"limits": {"force_max_mN": 20.1}}), PredictionCache()
    within = plan(rig, kind="grip", force_mN=15.0)
    assert teller.checked(within) is within
    beyond = plan(rig, kind="grip", force_mN=20.0)
    checked = teller.checked(beyond).plan
    assert not checked.feasible
    assert [item.quantity for item in checked.violations] == ["force"]


def test_a_release_and_a_calibration_are_accepted_without_a_prediction() -> None:
    def play(_planned: Planned) -> DryRun:
        raise AssertionError("must not be played")

    for wishes in (
        {"kind": "release"},
        {"kind": "hold", "hold_s": 1.0},
        {"kind": "calibrate", "calibration": "noise"},
    ):
        planned = plan(straight(), Present(1.0, 19.0, True), **wishes)
        assert PredictionCache(play).checked(planned) is planned


def test_a_missing_prediction_does_not_refuse_a_job() -> None:
    planned = plan(straight(), Present(1.0, 1e6, False), kind="grip")
    assert PredictionCache().checked(planned) is planned


def test_the_same_plan_is_predicted_once() -> None:
    requests: list[float] = []

    def count(planned: Planned) -> DryRun:
        requests.append(planned.plan.duration_s)
        return nothing()

    teller, first = PredictionCache(count), plan(straight(), kind="grip")
    assert teller.dry_run(first) is teller.dry_run(plan(straight(), kind="grip"))
    teller.dry_run(plan(straight(), kind="grip", hold_s=1.0))
    assert len(requests) == 2
    assert requests[0] > requests[1]
    teller.dry_run(plan(demo_rig(time="lockstep"), kind="grip"))
    assert len(requests) == 3


def test_requests_that_would_wait_too_long_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    entered, go_on = threading.Event(), threading.Event()

    def wait(_planned: Planned) -> DryRun:
        entered.set()
        go_on.wait(10.0)
        return nothing()

    monkeypatch.setattr(prediction, "WAITING", 1)
    teller, planned = PredictionCache(wait), plan(straight(), kind="grip")
    other = threading.Thread(target=teller.dry_run, args=[planned])
    other.start()
    assert entered.wait(10.0)
    with pytest.raises(ProblemError, match="1 predictions are waiting"):
        teller.dry_run(planned)
    go_on.set()
    other.join(10.0)
    assert teller.dry_run(planned).outcome == "gripped"


def test_an_arm_out_of_the_sensors_range_cannot_be_predicted() -> None:
    planned = plan(straight(), Present(1.0, 1e6, False), kind="grip")
    with pytest.raises(ProblemError, match="outside the sensor's range"):
        PredictionCache().predicted(planned)
