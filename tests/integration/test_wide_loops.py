"""``free_response`` of arms that nobody knows, with loops of 5 to 45 % and outputs with little lag.

The rigs are drawn by seed. A part that is left in the way must be found before it is pressed with
6 mN, and a free arm must go its whole way. The long tables run in ``make soak``.
"""

from itertools import product

import numpy as np
import pytest
from msgspec.structs import replace

from pincette.config import RigFile
from pincette.config.simulation import Relays
from pincette.core.messages import GroundTruth, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.planning.job_plans import plan_job
from tests.integration.test_touches import with_part
from tests.support.calibrating import REQUEST
from tests.support.drawn.random_rigs import with_gain, with_loop
from tests.support.twenty_rigs import unknown_rig

MOST_MN = 6.0
PLACES_UM = (4.0, 40.0)
DRAWN_BY = 0x4611
REQUESTED = {"kind": "calibrate", "calibration": "free_response", "most_V": 2.6}


def drawn(seed: int, *, relays: bool) -> tuple[RigFile, float]:
    """A rig and the place of a part, in µm, both by the seed."""
    chance = np.random.default_rng((DRAWN_BY, seed, relays))
    rig = unknown_rig("slow", seed, relays=False)
    assert rig.simulation is not None
    loop_percent, gain = float(chance.uniform(5.0, 45.0)), float(chance.uniform(16.0, 22.0))
    simulation = rig.simulation
    if relays:
        shape = Relays(
            loop_share=loop_percent / 100.0,
            full_drive_V=float(chance.uniform(2.0, 3.0)),
            coercive_share=float(chance.uniform(0.9, 1.6)),
            spread_share=float(chance.uniform(0.5, 1.2)),
            centre_V=float(chance.uniform(0.0, 1.5)),
        )
        simulation = simulation.model_copy(update={"hysteresis": None, "relays": shape})
        simulation = with_gain(simulation, gain)
    else:
        simulation = with_loop(simulation, gain, loop_percent)
    update = {"output_lag_s": float(chance.choice([0.0, chance.uniform(0.0, 0.005)]))}
    rig = rig.model_copy(update={"simulation": simulation.model_copy(update=update)})
    return rig, float(chance.uniform(*PLACES_UM))


def course(rig: RigFile) -> tuple[str, float]:
    """Outcome of the course, which reaches every place for the first time, and the peak force."""
    program = plan_job(REQUEST.validate_python(REQUESTED), rig).program
    ends = [segment.phase for segment in program.segments].index("before presses")
    published = ComposedLoop(rig).play(replace(program, segments=program.segments[:ends]))
    seen = [message for message in published if isinstance(message, Telemetry)][-1]
    return seen.outcome, max(m.force_mN for m in published if isinstance(m, GroundTruth))


def require_found(seed: int, *, relays: bool) -> None:
    """Leave a part in the way."""
    rig, place_um = drawn(seed, relays=relays)
    outcome, most_mN = course(with_part(rig, place_um))
    print(seed, relays, f"{place_um:.1f} µm", outcome, f"{most_mN:.2f} mN")
    # An arm that goes farther than its limits is stopped there, perhaps before the part.
    assert most_mN < MOST_MN
    assert outcome == "contact" or (outcome == "overtravel" and most_mN == 0.0)


def require_free(seed: int, *, relays: bool) -> None:
    """Take the part away."""
    rig, _ = drawn(seed, relays=relays)
    outcome, most_mN = course(with_part(rig, None))
    assert most_mN == 0.0
    assert outcome in {"moved", "overtravel"}, f"seed {seed}, relays {relays}: {outcome}"


@pytest.mark.parametrize(("seed", "relays"), [(104, False), (105, True)])
def test_a_part_in_the_way_of_an_arm_with_a_wide_loop_is_found(seed: int, relays: bool) -> None:
    require_found(seed, relays=relays)


@pytest.mark.parametrize(("seed", "relays"), [*product(range(200, 206), (False, True))])
def test_twelve_unknown_arms_find_a_part_and_go_a_free_way(seed: int, relays: bool) -> None:
    require_found(seed, relays=relays)
    require_free(seed, relays=relays)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "relays"), [*product(range(300, 330), (False, True))])
def test_sixty_unknown_arms_find_a_part_and_go_a_free_way(seed: int, relays: bool) -> None:
    require_found(seed, relays=relays)
    require_free(seed, relays=relays)
