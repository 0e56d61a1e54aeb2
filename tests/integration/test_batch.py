"""A batch has the numbers of the composed loop, to the last bit, whatever rig, law and seed."""

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace

from pincette.config import RigFile, read_rig
from pincette.control.laws.definition import LawSettings
from pincette_batch.cases import Case, Run
from pincette_batch.composed import play_composed
from pincette_batch.kernel.lane import COLUMNS, Ending
from pincette_batch.lanes import play_lane
from pincette_batch.prepared import prepare_rig
from pincette_batch.runs import play_all
from pincette_study.closed_loop import tracking_plan
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.batches import LAWS, drawn_rig, same, short_grip, short_track
from tests.support.laws import DSMIFC
from tests.support.rigs import KILOHERTZ, Tree, demo_rig

BOTH: Tree = {
    "second_mode": {"share": 0.0255},
    "passive_natural_frequency_rad_per_s": 2437.8,
}


@pytest.mark.parametrize("seed", range(6))
def test_drawn_rigs_run_as_they_do_composed(seed: int) -> None:
    rig = drawn_rig(seed)
    law = LAWS[seed % len(LAWS)]
    case = Case(rig, replace(short_track(rig), laws=(law.spec(),)), seed)
    run, composed = play_lane(prepare_rig(rig), case), play_composed(case)
    assert composed.ending is Ending.DONE
    # The response of the demo's arm fits a drawn arm badly: where the force in free space is then
    # above a touch's, the lane leaves it to the composed loop to say whether there was one.
    assert run.ending in {Ending.DONE, Ending.CONTACT}
    same(dataclasses.replace(run, ending=composed.ending, outcome=composed.outcome), composed)


@pytest.mark.parametrize(
    ("changes", "law"),
    [
        ({"second_mode": {"share": 0.0255}}, LAWS[0]),
        ({"passive_natural_frequency_rad_per_s": 2437.8}, LAWS[0]),
        ({"second_mode": {"share": 0.0255}, "part": {"modulus_GPa": 37.95}}, LAWS[0]),
        ({**BOTH, "part": {"modulus_GPa": 37.95, "adhesion_J_per_m2": 0.05}}, LAWS[1]),
    ],
    ids=["two modes", "two arms", "Hertz", "all of it"],
)
def test_arms_with_modes_of_their_own_run_as_they_do_composed(
    changes: Tree, law: LawSettings
) -> None:
    rig = demo_rig({"simulation": changes}, time="lockstep")
    case = Case(rig, replace(short_track(rig), laws=(law.spec(),)))
    run = play_lane(prepare_rig(rig), case)
    assert run.ending is Ending.DONE
    same(run, play_composed(case))


@pytest.mark.parametrize("law", LAWS, ids=lambda law: f"{law.scheme}-{law.set}")
def test_a_grip_runs_as_it_does_composed(law: LawSettings) -> None:
    rig = demo_rig(time="lockstep")
    case = Case(rig, replace(short_grip(rig), laws=(law.spec(),)))
    run = play_lane(prepare_rig(rig), case)
    assert run.outcome == "gripped"
    same(run, play_composed(case))


def test_without_a_part_the_lane_ends_and_the_composed_loop_says_how() -> None:
    rig = demo_rig({"simulation": {"bead": False}}, time="lockstep")
    case = Case(rig, short_track(rig))
    assert play_lane(prepare_rig(rig), case).ending is Ending.NO_CONTACT
    (again,) = play_all([case])
    assert (again.ending, again.outcome) == (Ending.OTHERWISE, "no_contact")


def test_a_lane_that_ends_early_is_right_until_there() -> None:
    rig = demo_rig({"limits": {"force_max_mN": 9.0}}, time="lockstep")
    case = Case(rig, short_track(rig))
    run = play_lane(prepare_rig(rig), case)
    assert run.ending is Ending.OVERFORCE
    ticks = run.columns.shape[1]
    assert np.array_equal(run.columns, play_composed(case).columns[:, :ticks])


def test_what_the_kernel_does_not_follow_is_played_composed() -> None:
    rig = demo_rig({"simulation": {"averaging_s": 0.004}}, time="lockstep")
    case = Case(rig, short_track(rig))
    (run,) = play_all([case])
    same(run, play_composed(case))


def test_at_1_khz_a_batch_has_the_bits_of_one_loop() -> None:
    rig = read_rig(KILOHERTZ)
    request = GripJobRequest(kind="grip", hold_s=0.02)
    case = Case(rig, plan_job(request, rig).program)
    (run,) = play_all([case])
    assert run.outcome == "gripped"
    same(run, play_composed(case))


def errors_of(_case: Case, run: Run) -> tuple[float, float]:
    return run.rmse("track")


def gains_and_seeds(rig: RigFile) -> list[Case]:
    track = short_track(rig)
    return [
        Case(
            rig,
            replace(track, laws=(DSMIFC.settings(K_f=K_f).spec(),)),
            seed,
        )
        for K_f in (0.0, 2000.0)
        for seed in (1, 2, 3)
    ]


def test_two_processes_give_what_one_gives_in_order() -> None:
    cases = gains_and_seeds(demo_rig(time="lockstep"))
    told: list[tuple[int, int]] = []
    alone = play_all(cases, keep=errors_of, progress=lambda done, all_: told.append((done, all_)))
    assert told[-1] == (6, 6)
    assert len(set(alone)) == 6
    assert play_all(cases, keep=errors_of, workers=2) == alone


def test_without_the_compiler_the_numbers_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    case = gains_and_seeds(demo_rig(time="lockstep"))[1]
    (fast,) = play_all([case])
    monkeypatch.setattr("pincette_batch.runs.available", lambda: False)
    (slow,) = play_all([case])
    same(fast, slow)


def test_no_process_is_refused() -> None:
    with pytest.raises(ValueError, match="workers = 0"):
        play_all([], workers=0)


def test_columns_are_named_in_their_order() -> None:
    rig = demo_rig(time="lockstep")
    run = play_composed(Case(rig, tracking_plan(rig, x_pp_um=4.0).program))
    assert run.columns.shape[0] == len(COLUMNS)
    assert np.ptp(run.x_um) > 30.0
    assert set(run.phases) >= {"track", "load"}
