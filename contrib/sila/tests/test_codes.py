"""Every outcome and every ending of a job becomes an error that SiLA defines."""

from typing import Any, cast, get_args

import pytest

from pincette.api.endings import Ending, EndingCode
from pincette.api.jobs import Job
from pincette.api.results import OutcomeCode
from pincette.client import JobEndedError
from pincette_sila.errors import command_error


def ended(**changes: Any) -> JobEndedError:
    """A failed job, from the documented example."""
    extra = Job.model_config.get("json_schema_extra")
    assert isinstance(extra, dict)
    examples = cast("list[dict[str, Any]]", extra["examples"])
    return JobEndedError("it has ended", Job.model_validate({**examples[0], **changes}))


@pytest.mark.parametrize("outcome", get_args(OutcomeCode))
def test_every_outcome_is_converted(outcome: OutcomeCode) -> None:
    error = command_error(ended(state="failed", ending=None, result={"outcome": outcome}))
    assert error.identifier == "JobFailed"


@pytest.mark.parametrize("code", get_args(EndingCode))
def test_every_ending_is_converted(code: EndingCode) -> None:
    error = command_error(ended(state="failed", ending=Ending(code=code).model_dump()))
    assert error.identifier == ("RigLatched" if code == "tripped" else "JobFailed")
