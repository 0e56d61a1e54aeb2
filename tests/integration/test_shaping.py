"""Steps of the voltage in three parts, or an RC, leave the mode at rest on a fast output."""

from functools import cache

import numpy as np
import pytest

from pincette.core.messages import Estimate, GroundTruth, Message, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.track import TrackJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.fast_output import Kind, fast_rig

PP_MN = 16.0
TRACK = TrackJobRequest(
    kind="track",
    shape="sinusoid",
    force_mean_mN=12.0,
    force_pp_mN=PP_MN,
    frequency_hz=2.0,
    cycles=4,
    load_s=1.0,
)


@cache
def played(kind: Kind) -> list[Message]:
    """Return all messages of the path."""
    rig = fast_rig(kind)
    return ComposedLoop(rig).play(plan_job(TRACK, rig).program)


def errors(kind: Kind) -> tuple[float, float]:
    """Return the r.m.s. error of the stated force in % of the path, and the cover of U."""
    published = played(kind)
    true_mN = {one.seq: one.arms[0].force_mN for one in published if isinstance(one, GroundTruth)}
    tracked = {one.seq for one in published if isinstance(one, Telemetry) and one.phase == "track"}
    stated = [
        one
        for one in published
        if isinstance(one, Estimate) and one.valid and one.seq in tracked and one.seq in true_mN
    ]
    assert len(stated) > 90
    missed_mN = np.array([one.arms[0].force_mN - true_mN[one.seq] for one in stated])
    u_mN = np.array([one.arms[0].force_uncertainty_mN for one in stated])
    rms_mN = float(np.sqrt(np.mean(missed_mN**2)))
    return 100.0 * rms_mN / PP_MN, float(np.mean(np.abs(missed_mN) <= u_mN))


def test_one_write_rings_the_mode_and_u_says_so() -> None:
    error_percent, cover = errors("one write")
    assert error_percent > 4.0
    assert cover > 0.85


@pytest.mark.parametrize(("kind", "most_percent"), [("three writes", 1.2), ("RC", 2.3)])
def test_three_writes_or_an_rc_do_not(kind: Kind, most_percent: float) -> None:
    error_percent, cover = errors(kind)
    assert error_percent < most_percent
    assert cover > 0.9
