"""Pass errors with given codes through the node of MADSci: run in the node's environment.

The standard input has a list of objects, each with the JSON of a job or of a problem. Print a list
of the data that the stock models of MADSci keep about each failed action.
"""
# pyright: basic, reportMissingImports=false

import json
import sys
from typing import Any

from madsci.common.types.action_types import ActionFailed

from pincette.api.jobs import Job
from pincette.client import ClientError, JobEndedError, ProblemError
from pincette_madsci.node import failed


def error_of(given: dict[str, Any]) -> ClientError:
    """Return the error that the client raises for an ended job or for a refusal."""
    if "job" in given:
        return JobEndedError("it has ended", Job.model_validate_json(json.dumps(given["job"])))
    return ProblemError(422, given["problem"])


def main() -> None:
    """Print the result of the node for each error."""
    results = [failed(error_of(given)) for given in json.load(sys.stdin)]
    sent = [ActionFailed.model_validate_json(one.model_dump_json()) for one in results]
    found = [{"type": one.errors[0].error_type, "json": one.json_result} for one in sent]
    print(json.dumps(found))


if __name__ == "__main__":
    main()
