"""A path tracked by the whole loop: the contact is found, and position and force are tracked
together."""

from functools import lru_cache

import pytest

from pincette.config import IdentifiedFreeResponse, RigFile
from pincette.core.messages import Message, Sample
from pincette.engine.composed import ComposedLoop
from pincette.records.columns import columns
from pincette_supervisor.kinds.track import TrackJobRequest, TrackResult
from pincette_supervisor.kinds.track.functions import evaluate
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Run
from tests.support.rigs import demo_rig

STIFFNESS, CONTACT_UM, GAIN = 2.11, 31.2, 19.0


def tracked(rig: RigFile, shape: str) -> TrackResult:
    request = TrackJobRequest.model_validate({"kind": "track", "shape": shape})
    planned = plan_job(request, rig)
    assert planned.plan.violations == []
    published = ComposedLoop(rig).play(planned.program)
    samples: list[Message] = [
        message for message in published if not isinstance(message, Sample) or message.seq >= 0
    ]
    result = evaluate(Run(rig, planned, columns(samples, rig.rig.period_s))).result
    assert isinstance(result, TrackResult)
    return result


def known_rig(seed: int) -> RigFile:
    """Return a rig whose arm has no hysteresis or creep, so that the estimator's only error is
    the noise."""
    rig = demo_rig(
        {
            "simulation": {
                "seed": seed,
                "creep_per_decade": 0.0,
                "piezo_um_per_V": GAIN,
                "bead_contact_um": CONTACT_UM,
                "environment_stiffness_mN_per_um": STIFFNESS,
                "hysteresis": {"A_over_d": 0.0},
            }
        },
        time="lockstep",
    )
    line = IdentifiedFreeResponse(thresholds_V=(0.0,), weights_um_per_V=(GAIN,), residual_um=0.01)
    model = rig.model.model_copy(update={"free_response": line, "piezo_um_per_V": GAIN})
    return rig.model_copy(update={"model": model})


@lru_cache
def on_a_known_arm(shape: str, seed: int) -> TrackResult:
    return tracked(known_rig(seed), shape)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_contact_is_identified_to_one_percent(seed: int) -> None:
    result = on_a_known_arm("sinusoid", seed)
    assert result.outcome == "tracked"
    assert result.contact_stiffness_mN_per_um == pytest.approx(STIFFNESS, rel=0.01)
    assert result.contact_x_um == pytest.approx(CONTACT_UM, abs=0.1)


@pytest.mark.parametrize("shape", ["sinusoid", "triangle", "step"])
def test_position_and_force_are_tracked_within_one_per_cent(shape: str) -> None:
    result = on_a_known_arm(shape, 1)
    for tracking in (result.position_um, result.force_mN, result.true_force_mN):
        assert tracking is not None
        assert tracking.rmse_percent is not None
        assert tracking.rmse_percent < 1.0
    assert result.limits_acted == []


def test_the_demo_rig_tracks_the_path_of_its_file() -> None:
    rig = demo_rig(time="lockstep")
    result = tracked(rig, rig.track.shape)
    assert result.outcome == "tracked"
    assert [phase.phase for phase in result.phases][3:] == [
        "load",
        "settle",
        "track",
        "unload",
        "retreat",
    ]
    cycle = round(1.0 / rig.track.frequency_hz / rig.rig.period_s)
    assert result.tracked_samples == rig.track.cycles * cycle
    assert result.force_pp_mN == pytest.approx(rig.track.force_pp_mN, rel=0.01)
    for tracking in (result.position_um, result.force_mN, result.true_force_mN):
        assert tracking is not None
        assert tracking.rmse_percent is not None
        assert tracking.rmse_percent < 10.0
    assert result.missed_ticks == result.unanswered_ticks == 0
