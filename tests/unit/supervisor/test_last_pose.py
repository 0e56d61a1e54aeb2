"""Steps by a distance start from the last target, not from a noisy reading."""

from dataclasses import replace
from typing import Any

import pytest

from pincette_supervisor.jobs.planner import last_pose_um
from pincette_supervisor.journal.tables import JobRow
from pincette_supervisor.plugin import Present

from .test_motions import RIG, plan

RESULT = {"target_um": 10.0, "ends_at": {"x_um": 10.01, "voltage_V": 0.5}}
STANDS = Present(0.501, 9.97, held=False)


def move(result: dict[str, Any], epoch: int | None = 7, **more: Any) -> JobRow:
    row = JobRow("a", "move", "demo", "succeeded", {}, {}, "", result=result, epoch=epoch)
    return replace(row, **more)


def test_steps_forward_and_back_end_at_the_starting_position() -> None:
    at_um = 10.0
    for step, reading_error_um in enumerate((-0.03, 0.02, 0.05, -0.04, 0.01, -0.05)):
        rows = [move({**RESULT, "target_um": at_um})]
        stands = replace(STANDS, x_um=at_um + reading_error_um)
        stands = replace(stands, pose_um=last_pose_um(rows, stands))
        by_um = 5.0 if step % 2 == 0 else -5.0
        at_um = plan({"kind": "move", "by_um": by_um}, stands)[0].values["to_um"]
        assert at_um == (15.0 if step % 2 == 0 else 10.0)


def test_a_move_by_voltage_reports_the_mean_position_at_rest() -> None:
    assert last_pose_um([move({**RESULT, "target_um": None})], STANDS) == 10.01


def test_a_job_that_was_never_armed_leaves_no_pose() -> None:
    waiting = move({}, None, kind="grip", state="queued")
    assert last_pose_um([waiting, move(RESULT)], STANDS) == 10.0


@pytest.mark.parametrize(
    ("rows", "stands"),
    [
        ([], STANDS),
        ([move(RESULT, state="failed")], STANDS),
        ([move(RESULT, kind="grip")], STANDS),
        ([move(RESULT, 7), move({}, 8, kind="grip")], STANDS),
        ([move({})], STANDS),
        ([move(RESULT)], replace(STANDS, voltage_V=0.7)),
        ([move(RESULT)], replace(STANDS, x_um=12.0)),
        ([move(RESULT)], replace(STANDS, x_um=None)),
        ([move(RESULT)], replace(STANDS, voltage_V=None)),
    ],
)
def test_relative_steps_of_an_arm_that_was_moved_otherwise_start_at_its_reading(
    rows: list[JobRow], stands: Present
) -> None:
    assert last_pose_um(rows, stands) is None
    planned, _ = plan({"kind": "move", "by_um": 3.0}, stands)
    assert planned.values["to_um"] == stands.stand_um(RIG) + 3.0
