"""Every outcome of a job that has failed becomes a defined error of SiLA."""

from typing import get_args

import pytest

from pincette.api.jobs import Job
from pincette.api.results import OutcomeCode
from pincette.api.states import GOOD_OUTCOMES
from pincette.client import JobEndedError
from pincette_sila.errors import command_error
from tests.unit.client.desk import example

BAD = [code for code in get_args(OutcomeCode) if code not in (*GOOD_OUTCOMES, "tripped")]


@pytest.mark.parametrize("outcome", BAD)
def test_the_error_of_a_job_that_failed_by_its_outcome_contains_the_outcome_code(
    outcome: str,
) -> None:
    job = Job.model_validate(example(Job, state="failed", result={"outcome": outcome}, ending=None))
    error = command_error(JobEndedError(f"job {job.id} failed: {outcome}", job))
    assert error.identifier == "JobFailed"
    assert outcome in str(error)
