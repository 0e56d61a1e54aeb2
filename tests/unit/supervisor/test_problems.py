"""Every problem states a remedy, can be found in the log, and uses pincette's own texts."""

import ast
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic_core.core_schema import ErrorType

import pincette_supervisor
from pincette.api.problems import REMEDIES, TYPE
from pincette.core.validation_wording import refusal
from pincette_supervisor.problems import CODES

from .harness import Harness

SOURCES = sorted(Path(pincette_supervisor.__file__).parent.rglob("*.py"))
OWN_TEXT = {"value_error", "assertion_error"}
"""Codes of errors whose text a validator of pincette has written."""
PYDANTIC = ("Input should", "Value error", "Field required", "Extra inputs", "pydantic")


def raised_codes() -> set[str]:
    """Codes of all problems that the supervisor's source raises."""
    found = set(CODES.values())
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name):
                continue
            code = node.args[1] if len(node.args) > 1 else None
            if node.func.id == "ProblemError" and isinstance(code, ast.Constant):
                found.add(str(code.value))
    return found


def test_every_problem_that_is_raised_has_a_remedy() -> None:
    codes = raised_codes()
    assert len(codes) > 20
    assert codes - REMEDIES.keys() == set()


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("GET", "/api/v1/jobs/none", None),
        ("PUT", "/api/v1/jobs", {}),
        ("POST", "/api/v1/jobs", {"kind": "grip", "force_mN": -1.0}),
        ("POST", "/api/v1/jobs", {"kind": "grip", "force_mN": 60.0}),
        ("GET", "/api/v1/jobs?colour=red", None),
        ("GET", "/api/v2/jobs", None),
    ],
)
def test_a_problem_has_a_remedy_and_an_instance(
    harness: Harness, method: str, path: str, body: Any
) -> None:
    first, second = (harness.call(method, path, json=body).json() for _ in range(2))
    code = first["type"].removeprefix(TYPE)
    assert first["remedy"] == REMEDIES[code]
    assert first["instance"].startswith("urn:uuid:")
    assert first["instance"] != second["instance"]


def test_the_instance_of_a_problem_is_written_to_the_log(
    harness: Harness, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level("INFO"):
        problem = harness.call("GET", "/api/v1/jobs/none").json()
    assert problem["instance"] in caplog.text


@pytest.mark.parametrize("code", sorted({*get_args(ErrorType)} - OWN_TEXT))
def test_no_error_text_comes_from_pydantic(code: str) -> None:
    text = refusal({"type": code, "msg": "Input should be valid", "ctx": {}}, "mN")
    assert text.startswith(("must ", "is ", "cannot "))
    assert not any(word in text for word in PYDANTIC)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (-1.0, "force_mN = -1.0 mN: must be above 0 mN"),
        ("much", "force_mN = 'much' mN: must be a number"),
        (True, "force_mN = true mN: must be a number"),
        (None, ""),
    ],
)
def test_a_refused_number_is_reported_with_value_unit_and_limit(
    harness: Harness, value: Any, words: str
) -> None:
    answer = harness.post("/jobs", {"kind": "grip", "force_mN": value, "dry_run": True})
    if not words:
        assert answer.status_code == 200, answer.text
        return
    (error,) = answer.json()["errors"]
    assert error["message"].startswith(words)
    assert error["pointer"] == "/force_mN"
