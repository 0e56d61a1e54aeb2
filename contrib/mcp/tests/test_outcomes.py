"""The agent receives every outcome of a job as a code."""

from typing import get_args

import pytest
from mcp.server.mcpserver.exceptions import ToolError

from pincette.api.results import OutcomeCode
from pincette.client import JobEndedError
from pincette_mcp.calls import tool_errors
from pincette_mcp.server import Gripped
from tests.unit.client.test_outcomes import BAD, ended


@pytest.mark.parametrize("outcome", BAD)
def test_the_error_of_a_tool_begins_with_the_code(outcome: str) -> None:
    error = JobEndedError("job x failed", ended(outcome))
    with pytest.raises(ToolError, match=rf"^job-failed \({outcome}\): "), tool_errors():
        raise error


@pytest.mark.parametrize("outcome", get_args(OutcomeCode))
def test_the_answer_of_a_tool_contains_the_outcome_code(outcome: OutcomeCode) -> None:
    given = {"job": "a", "force_held_mN": None, "force_uncertainty_mN": None}
    assert Gripped.model_validate({**given, "outcome": outcome}).outcome == outcome
