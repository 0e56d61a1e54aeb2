"""``free_response`` of unknown arms, with loops of 5 to 45 % and outputs with little lag.

The rigs are drawn by seed. A part that is left in the path must be found before it is pressed with
6 mN, and a free arm must complete its motion. The long tests run in ``make soak``.
"""

from itertools import product
from typing import Any

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
from tests.support.campaign.arm import Part
from tests.support.campaign.drawing import draw
from tests.support.campaign.laboratory import bench_of
from tests.support.drawn.random_rigs import with_gain, with_loop
from tests.support.twenty_rigs import unknown_rig

MOST_MN = 6.0
PLACES_UM = (4.0, 40.0)
NOISE_UM = 0.03
"""Sensor noise for play arms, in µm; it is as low for the other classes."""
DRAWN_BY = 0x4611
REQUESTED = {"kind": "calibrate", "calibration": "free_response", "most_V": 2.6}


def drawn(seed: int, *, relays: bool) -> tuple[RigFile, float]:
    """Draw a rig and the position of a part, in µm, from the seed."""
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
    """Return the outcome of the motion, which reaches every position for the first time, and the
    peak force."""
    program = plan_job(REQUEST.validate_python(REQUESTED), rig).program
    ends = [segment.phase for segment in program.segments].index("before presses")
    published = ComposedLoop(rig).play(replace(program, segments=program.segments[:ends]))
    seen = [message for message in published if isinstance(message, Telemetry)][-1]
    return seen.outcome, max(m.arms[0].force_mN for m in published if isinstance(m, GroundTruth))


def require_found(seed: int, *, relays: bool) -> None:
    """Check that a part left in the path is found."""
    rig, place_um = drawn(seed, relays=relays)
    outcome, most_mN = course(with_part(rig, place_um))
    print(seed, relays, f"{place_um:.1f} µm", outcome, f"{most_mN:.2f} mN")
    # An arm that moves beyond its limits is stopped there, perhaps before the part.
    assert most_mN < MOST_MN
    assert outcome == "contact" or (outcome == "overtravel" and most_mN == 0.0)


def require_free(seed: int, *, relays: bool) -> None:
    """Check that the motion completes without the part."""
    rig, _ = drawn(seed, relays=relays)
    outcome, most_mN = course(with_part(rig, None))
    assert most_mN == 0.0
    assert outcome in {"moved", "overtravel"}, f"seed {seed}, relays {relays}: {outcome}"


@pytest.mark.parametrize(("seed", "relays"), [(104, False), (105, True)])
def test_a_part_in_the_path_of_an_arm_with_a_wide_loop_is_detected(seed: int, relays: bool) -> None:
    require_found(seed, relays=relays)


@pytest.mark.parametrize(("seed", "relays"), [*product((200, 201), (False, True))])
def test_four_unknown_arms_find_a_part_and_complete_a_free_motion(seed: int, relays: bool) -> None:
    require_found(seed, relays=relays)
    require_free(seed, relays=relays)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "relays"), [*product(range(300, 330), (False, True))])
def test_sixty_unknown_arms_find_a_part_and_complete_a_free_motion(seed: int, relays: bool) -> None:
    require_found(seed, relays=relays)
    require_free(seed, relays=relays)


def play_arm(seed: int, contact_um: float | None, **more: Any) -> tuple[str, float, float]:
    """Play the motion on an arm of the campaign.

    Return its outcome, the peak force, and the initial force, in mN.
    """
    arm = draw(seed)
    arm.arm.noise_um, arm.arm.drift_um_per_s = NOISE_UM, 0.0
    sensor = arm.rig.sensor.model_copy(update={"noise_um": NOISE_UM, "drift_um_per_min": 0.0})
    rig = arm.rig.model_copy(update={"sensor": sensor})
    arm.arm.part = None if contact_um is None else Part(contact_um, arm.stiffness_mN_per_um)
    arm.arm.rest(0.5)
    begin_mN, arm.arm.peak_mN = arm.arm.force_mN, 0.0
    program = plan_job(REQUEST.validate_python({**REQUESTED, **more}), rig).program
    ends = [segment.phase for segment in program.segments].index("before presses")
    loop = ComposedLoop(rig, lambda _publish: bench_of(arm))
    published = loop.play(replace(program, segments=program.segments[:ends]))
    seen = [message for message in published if isinstance(message, Telemetry)][-1]
    print(arm.label, contact_um, more, seen.outcome, f"{begin_mN:.2f} mN, {arm.arm.peak_mN:.2f} mN")
    return seen.outcome, arm.arm.peak_mN, begin_mN


def require_arm_of_plays(seed: int) -> None:
    """Check that a part in the path of a play arm is found, and that the arm completes its
    motion without one."""
    place_um = float(np.random.default_rng((DRAWN_BY, seed)).uniform(*PLACES_UM))
    assert draw(seed).kind == "plays"
    outcome, most_mN, _ = play_arm(seed, place_um)
    assert most_mN < MOST_MN
    assert outcome == "contact" or (outcome == "overtravel" and most_mN == 0.0)
    outcome, most_mN, _ = play_arm(seed, None)
    assert most_mN == 0.0
    assert outcome in {"moved", "overtravel"}


def test_an_arm_with_play_hysteresis_finds_a_part_and_completes_a_free_motion() -> None:
    require_arm_of_plays(50_002)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [50_005 + 3 * number for number in range(20)])
def test_twenty_arms_with_play_hysteresis_find_a_part_and_complete_a_free_motion(seed: int) -> None:
    require_arm_of_plays(seed)


PRESSED, TO_PRESS = (-8.0, -3.0), (5.0, 25.0)
"""Positions of a part that presses the arm at rest, and of one that the arm meets during its
motion."""
BENT = 1053
"""A relay arm whose curve bends near saturation as if it met a soft part."""


def require_pressing_found(seed: int) -> None:
    """Check that a part is found that presses the arm at rest, such as a held or forgotten part."""
    for place_um in PRESSED:
        outcome, most_mN, begin_mN = play_arm(seed, place_um)
        assert outcome == "contact"
        assert most_mN < max(MOST_MN, begin_mN + 1.0)


def require_found_although_confirmed(seed: int) -> None:
    """Check that a part is found although a person has stated that there is none."""
    for place_um in (*PRESSED, *TO_PRESS):
        outcome, most_mN, begin_mN = play_arm(seed, place_um, no_part=True)
        assert outcome == "contact"
        assert most_mN < max(MOST_MN, begin_mN + 1.0)
    outcome, most_mN, _ = play_arm(seed, None, no_part=True)
    assert (outcome, most_mN) == ("moved", 0.0)


def test_a_part_that_presses_the_arm_at_the_start_is_found() -> None:
    """There is no kink in newly reached positions: such parts were pressed with 70 mN to the end
    of the motion."""
    require_pressing_found(7002)


def test_a_part_is_found_although_a_person_has_confirmed_that_there_is_none() -> None:
    """The force reaches 7.4 mN if the contact limit is twice the contact force in this case, and
    70 mN without one."""
    require_found_although_confirmed(7001)


def test_a_free_arm_that_bends_completes_its_motion_if_no_part_is_confirmed() -> None:
    outcome, _, _ = play_arm(BENT, None, no_part=True, most_V=None)
    assert outcome == "moved"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(70_000, 70_024))
def test_arms_of_three_classes_find_a_part_that_presses_or_was_reported_absent(seed: int) -> None:
    require_pressing_found(seed)
    require_found_although_confirmed(seed)
