"""Zero return on the demo rig: the force when the free arm is back at the position of its zero."""

import pytest

from pincette.api.results import ZeroReturn
from pincette.engine.composed import ComposedLoop
from pincette.records.columns import columns
from pincette_supervisor.kinds.grip import KIND, GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin.zero_return import zero_return_of
from pincette_supervisor.results.documents import verdict
from tests.support.grips import SHORT
from tests.support.rigs import demo_rig
from tests.support.slips import Played, played


def returned(job: Played, **model: float) -> ZeroReturn | None:
    """Return the zero return of a job, on a rig with other errors of its free response."""
    rig = job.rig
    free = rig.model.free_response
    assert free is not None
    changed = rig.model.model_copy(update={"free_response": free.model_copy(update=model)})
    return zero_return_of(columns(job.messages, 0.02), rig.model_copy(update={"model": changed}))


@pytest.mark.parametrize("profile", ["quick", "gentle"])
def test_an_undisturbed_grip_is_verified(profile: str) -> None:
    job = played(profile=profile)
    assert job.outcome == "gripped"
    found = returned(job, return_error_um=0.1)
    assert found is not None
    assert found.verified
    assert found.x_um == pytest.approx(26.0, abs=0.5)
    assert 0.2 < found.uncertainty_mN < 1.2


def test_a_drift_of_the_sensor_in_the_hold_leaves_the_grip_unverified() -> None:
    """The drift of 1.2 µm makes the held force 1.3 mN too small; no step of the position reveals
    it."""
    job = played({"drift": {"slope_um_per_s": 0.3}}, hold_s=4.0)
    assert job.outcome == "gripped"
    found = returned(job, return_error_um=0.1)
    assert found is not None
    assert found.force_mN < -2.0
    assert not found.verified
    result = {"outcome": "gripped", "zero_return": found.model_dump()}
    assert "not verified" in verdict(KIND, result)


def test_without_a_measured_error_three_residuals_are_assumed() -> None:
    job = played()
    free = job.rig.model.free_response
    assert free is not None
    assert free.return_error_um is None
    found = zero_return_of(columns(job.messages, 0.02), job.rig)
    assert found == returned(job, return_error_um=3.0 * free.residual_um)


def test_ten_grips_in_succession_of_an_arm_without_a_measured_error_are_verified() -> None:
    rig = demo_rig(SHORT, time="lockstep")
    loop = ComposedLoop(rig)
    for number in range(10):
        planned = plan_job(GripJobRequest(kind="grip"), rig)
        messages = loop.play(planned.program, epoch=2 * number + 1)
        found = zero_return_of(columns(messages, rig.rig.period_s), rig)
        assert found is not None
        assert found.verified
        assert found.uncertainty_mN < 1.0


def test_a_job_without_contact_has_no_zero_return() -> None:
    job = played({"bead": False})
    assert job.outcome == "no_contact"
    assert zero_return_of(columns(job.messages, 0.02), job.rig) is None
