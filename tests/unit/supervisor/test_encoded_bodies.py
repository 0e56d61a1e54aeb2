"""JSON bodies as programs on Windows write them: with a byte order mark, or in UTF-16."""

import codecs

import pytest

from .harness import Harness

GRIP = '{"kind": "grip", "dry_run": true, "notes": "Müller"}'
JSON = {"content-type": "application/json"}


@pytest.mark.parametrize(
    "body",
    [
        codecs.BOM_UTF8 + GRIP.encode(),
        *(GRIP.encode(name) for name in ("utf-16", "utf-16-be", "utf-16-le", "utf-32")),
    ],
)
def test_every_encoding_of_json_is_read(harness: Harness, body: bytes) -> None:
    answer = harness.call("POST", "/api/v1/jobs", content=body, headers=JSON)
    assert (answer.status_code, answer.json()["feasible"]) == (200, True)


@pytest.mark.parametrize("body", [b"\xff" + GRIP.encode(), GRIP.encode("latin-1")])
def test_another_encoding_is_a_problem_that_names_the_byte(harness: Harness, body: bytes) -> None:
    answer = harness.call("POST", "/api/v1/jobs", content=body, headers=JSON)
    assert answer.status_code == 400
    assert answer.json()["type"] == "urn:pincette:problem:bad-json"
    assert f"byte {max(body.find(0xFF), body.find(0xFC))} " in answer.json()["detail"]
    assert harness.get("/jobs")["jobs"] == []
