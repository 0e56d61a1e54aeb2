"""Every outcome code of a job reaches the programs that use the client, as a code."""

from itertools import product
from typing import get_args

import pytest

from pincette.api.job_kinds import job_kinds
from pincette.api.jobs import Job
from pincette.api.results import OutcomeCode, PositionStep
from pincette.api.states import GOOD_OUTCOMES
from pincette.client import JobEndedError
from pincette_supervisor.results.job_table import csv_of, row_of
from tests.unit.client.desk import example

BAD = [code for code in get_args(OutcomeCode) if code not in GOOD_OUTCOMES]
STEP = example(PositionStep)


def ended(outcome: str) -> Job:
    result = {**example(job_kinds()["grip"].result), "outcome": outcome, "position_step": STEP}
    return Job.model_validate(example(Job, state="failed", result=result))


@pytest.mark.parametrize("outcome", BAD)
def test_a_client_receives_the_code_of_a_failed_job(outcome: str) -> None:
    error = JobEndedError("job x failed", ended(outcome))
    assert error.outcome == outcome
    assert (error.job.result or {})["position_step"] == STEP


def test_a_job_without_a_result_has_no_outcome() -> None:
    without = Job.model_validate(example(Job, state="failed", result=None))
    assert JobEndedError("job x failed", without).outcome == ""


@pytest.mark.parametrize("outcome", get_args(OutcomeCode))
def test_the_table_of_jobs_has_the_outcome_code_and_the_figures_of_a_position_step(
    outcome: str,
) -> None:
    content = b"".join(csv_of(lambda: iter([[row_of(ended(outcome))]])))
    head, row = content.decode().splitlines()[:2]
    columns = dict(zip(head.split(","), row.split(","), strict=False))
    assert columns["result.outcome"] == outcome
    for name in ("cause", "force_if_slip_mN", "force_if_sensor_mN", "slips"):
        assert columns[f"result.position_step.{name}"] == str(STEP[name])


@pytest.mark.parametrize("kind", ["grip", "track", "carry", "move", "hold", "release"])
def test_every_kind_of_result_carries_every_code(kind: str) -> None:
    for model, outcome in product(job_kinds()[kind].results, get_args(OutcomeCode)):
        tree = {**example(model), "outcome": outcome, "position_step": STEP}
        found = model.model_validate(tree)
        assert found.model_dump(mode="json")["outcome"] == outcome
        assert found.model_dump(mode="json")["position_step"]["cause"] == "unknown"
