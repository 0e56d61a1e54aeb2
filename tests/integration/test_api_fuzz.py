"""Requests that no schema can express: bytes, nesting, headers and paths that no client sends.

The supervisor replies to each with a documented status and a message, and nothing moves.
"""

import json
import random
from collections.abc import Generator
from typing import Any

import pytest

from tests.support.api_document import openapi
from tests.support.odd_requests import BODIES, FILES, GRIP, PLACES, RECIPES, TRAVERSALS, TYPES
from tests.support.raw_http import JSON_HEADERS, Answer, endless, send
from tests.support.rigs import demo_rig
from tests.unit.supervisor.harness import Harness

SEED = 20134
MUTANTS = 250
REFUSALS = {400, 401, 403, 404, 405, 406, 408, 409, 411, 413, 415, 421, 422, 429, 431, 503}
"""Statuses with which any request may be refused."""
MOST_SAID = 2**20
"""Largest size in bytes of the reply to a request of at most a megabyte."""
SECRETS = ("Traceback", 'File "', "sqlite", "site-packages")
"""Internal details of the program that no reply may contain."""


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Generator[Harness]:
    desk = Harness(demo_rig(time="lockstep"), tmp_path_factory.mktemp("desk"))
    yield desk
    desk.close()


@pytest.fixture(scope="module")
def job(desk: Harness) -> str:
    """Return a completed grip whose labels would do harm if they were trusted."""
    labels = {
        "part": '<script>alert("1")</script>',
        "who": 'x"\r\nSet-Cookie: a=b',
        "backwards": "\u202e",
    }
    name = str(desk.grip(labels=labels)["id"])
    desk.ended(name)
    return name


def refused(answer: Answer) -> dict[str, Any]:
    """Return the problem document of a refusal, and check that it contains no internal details."""
    assert answer.status in REFUSALS, (answer.status, answer.body[:300])
    problem = answer.problem
    shown(answer)
    return problem


def shown(answer: Answer) -> None:
    """Check a reply against the rules for every reply."""
    assert answer.status < 500 or answer.status == 503, (answer.status, answer.body[:300])
    text = answer.body.decode(errors="replace")
    assert [secret for secret in SECRETS if secret in text] == []
    for name, value in answer.headers.items():
        assert "\r" not in name + value
        assert "\n" not in name + value


@pytest.mark.parametrize("case", BODIES)
@pytest.mark.parametrize("place", ["/jobs", "/trajectories", "/trajectories/plot", "/calibrations"])
def test_an_invalid_body_is_refused_with_a_readable_message(
    desk: Harness, place: str, case: str
) -> None:
    before = desk.get("/jobs")["jobs"]
    answer = send(desk.app, "POST", f"/api/v1{place}?dry_run=true&predict=false", BODIES[case])
    shown(answer)
    assert len(answer.body) < MOST_SAID
    if answer.status not in (200, 201):
        refused(answer)
    assert desk.get("/jobs")["jobs"] == before


@pytest.mark.parametrize("body", [b"", b"[" * 100_000, b'{"values": NaN}', b'{"name": "\\ud800"}'])
def test_invalid_bodies_of_other_routes_are_refused(desk: Harness, job: str, body: bytes) -> None:
    for place in (
        "/recipes", f"/jobs/{job}/actions", "/rigs/demo/reset", "/rigs/demo/queue/actions",
        "/rigs/demo/model/actions", f"/calibrations/{job}/actions",
    ):  # fmt: skip
        refused(send(desk.app, "POST", f"/api/v1{place}", body))


@pytest.mark.parametrize("case", RECIPES)
def test_an_impossible_recipe_is_refused(desk: Harness, case: str) -> None:
    body = f'{{"name": "fuzz", "values": {RECIPES[case]}}}'.encode()
    refused(send(desk.app, "POST", "/api/v1/recipes", body))
    assert desk.get("/recipes")["recipes"] == []


@pytest.mark.parametrize("kind", TYPES, ids=repr)
def test_another_content_type_moves_nothing(desk: Harness, kind: bytes | None) -> None:
    headers = [] if kind is None else [(b"content-type", kind)]
    for body in (f"{{{GRIP}}}".encode(), b"a=1", b"--x\r\n\r\n--x--", b""):
        answer = send(desk.app, "POST", "/api/v1/jobs?dry_run=true&predict=false", body, headers)
        shown(answer)
        if answer.status != 200:
            refused(answer)


@pytest.mark.parametrize("place", PLACES)
def test_no_path_escapes_its_folder(desk: Harness, job: str, place: str) -> None:
    """Path parameters that name files take every odd path, each other parameter a third of them
    in turn."""
    turn = PLACES.index(place) % 3
    for odd in TRAVERSALS if place in FILES else TRAVERSALS[turn::3]:
        path = place.replace("{job}", job).replace("{}", odd)
        answer = send(desk.app, "GET", path)
        shown(answer)
        if answer.status >= 400:
            refused(answer)
        else:
            assert b"root:" not in answer.body


@pytest.mark.parametrize(
    "header",
    [
        (b"x-operator", b"\xff\xfe"), (b"x-operator", b"a" * 100_000), (b"x-operator", b""),
        (b"idempotency-key", b"k" * 10_000), (b"idempotency-key", b"\x00"), (b"accept", b"\xff"),
        (b"last-event-id", b"9" * 6000), (b"last-event-id", b"-1"),
        (b"if-none-match", b'"' * 50_000),
        (b"if-none-match", b'W/"{job}-' + b"9" * 5000 + b'"'),
        (b"range", b"bytes=0-,-1,5-4" * 2000),
        (b"range", b"bytes=" + b"0-1," * 5000), (b"cookie", b"a=b; " * 10_000),
        (b"content-length", b"-1"), (b"content-length", b"x"),
        (b"content-length", b"9" * 30),
        (b"transfer-encoding", b"chunked, chunked"), (b"host", b"evil.example\r\nx: y"),
        (b"authorization", b"Bearer \xff" * 1000), (b"origin", b"null"), (b"x" * 10_000, b"y"),
    ],
    ids=lambda header: repr(header[0][:20] + b": " + header[1][:20]),
)  # fmt: skip
def test_odd_headers_are_refused_or_ignored(
    desk: Harness, job: str, header: tuple[bytes, bytes]
) -> None:
    for method, path, body in (
        ("GET", f"/api/v1/jobs/{job}", b""),
        ("GET", f"/api/v1/jobs/{job}/events/list", b""),
        ("GET", f"/api/v1/jobs/{job}/artifacts/manifest.json", b""),
        ("GET", f"/api/v1/jobs/{job}/artifacts/samples.csv", b""),
        ("POST", "/api/v1/jobs?dry_run=true&predict=false", f"{{{GRIP}}}".encode()),
        ("POST", f"/api/v1/jobs/{job}/actions", b'{"type": "stop"}'),
    ):
        name, value = header
        named = (name, value.replace(b"{job}", job.encode()))
        shown(send(desk.app, method, path, body, [*JSON_HEADERS, named]))


def test_a_key_appears_nowhere(
    desk: Harness, job: str, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    key, stated = "pk-0a1b2c3d4e5f", ""
    headers = [
        *JSON_HEADERS,
        (b"authorization", f"Bearer {key}".encode()),
        (b"x-api-key", key.encode()),
        (b"cookie", f"session={key}".encode()),
    ]
    with caplog.at_level("DEBUG"):
        for method, path, body in (
            ("GET", f"/api/v1/jobs/{job}", b""),
            ("GET", "/api/v1/jobs/none", b""),
            ("POST", "/api/v1/jobs", b"[" * 100_000),
            ("POST", "/api/v1/jobs?dry_run=true", b'{"kind": "grip", "force_mN": NaN}'),
            ("POST", f"/api/v1/jobs/{job}/actions", b'{"type": "stop"}'),
            ("DELETE", "/api/v2/jobs", b""),
        ):
            answer = send(desk.app, method, path, body, headers)
            shown(answer)
            stated += f"{answer.headers}{answer.body.decode()}"
    written = capfd.readouterr()
    assert key not in stated + caplog.text + written.out + written.err
    assert "Traceback" not in caplog.text + written.out + written.err


def test_a_body_without_end_is_not_read_to_its_end(desk: Harness) -> None:
    chunk, most = b" " * 65_536, 400
    for place in ("/jobs?dry_run=true", "/recipes", "/trajectories", "/rigs/demo/reset"):
        answer = send(desk.app, "POST", f"/api/v1{place}", endless(chunk, most))
        assert refused(answer)["status"] == 413
        assert answer.read < most * len(chunk)


def test_an_emergency_stop_reads_no_body(desk: Harness) -> None:
    answer = send(desk.app, "POST", "/api/v1/rigs/demo/estop", endless(b"x" * 1024, 2))
    assert answer.status == 200
    assert desk.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200


def test_labels_appear_in_no_response_header_and_are_escaped_in_the_report(
    desk: Harness, job: str
) -> None:
    attached = send(desk.app, "GET", f"/api/v1/jobs/{job}/artifacts/samples.csv")
    assert attached.headers["content-disposition"] == f'attachment; filename="{job}.csv"'
    report = send(desk.app, "GET", f"/api/v1/jobs/{job}/artifacts/report.html")
    assert report.status == 200
    assert b"<script" not in report.body
    content = json.loads(send(desk.app, "GET", f"/api/v1/jobs/{job}").body)
    assert content["labels"]["part"] == '<script>alert("1")</script>'
    page = send(desk.app, "GET", "/?rig=%3Cscript%3E1%3C/script%3E")
    assert refused(page)["status"] == 404


@pytest.mark.parametrize("path", ["/api/v2/jobs", "/api/v0/rigs/demo/estop", "/api/v11", "/api/x"])
def test_a_request_for_another_version_is_answered_with_the_served_one(
    desk: Harness, path: str
) -> None:
    for method in ("GET", "POST"):
        problem = refused(send(desk.app, method, path))
        assert problem["status"] == 404
        assert "this supervisor serves /api/v1" in problem["detail"]
    unknown = refused(send(desk.app, "GET", "/api/v1/nothing"))
    assert "serves" not in unknown["detail"]


def documented() -> dict[tuple[str, str], set[int]]:
    """Return the statuses that the OpenAPI document states for each method and path."""
    return {
        (method.upper(), path): {int(status) for status in operation["responses"]}
        for path, methods in openapi()["paths"].items()
        for method, operation in methods.items()
    }


def mutants(chance: random.Random) -> Generator[bytes]:
    """Return bodies similar to a valid one: a value replaced by another, or some bytes changed."""
    sound: dict[str, Any] = {
        "kind": "grip", "force_mN": 15.0, "hold_s": 1.0, "labels": {"a": "b"}, "dry_run": True,
        "gains": {"K_P": 0.5}, "scheme": "pbsmic", "rig": "demo", "on_stop": "hold",
    }  # fmt: skip
    values = ("1e309", "NaN", "null", "true", "[]", "{}", '"x"', "-0.0", "1e-320", "0", "1" * 400)
    while True:
        pairs = [f'"{name}": {json.dumps(value)}' for name, value in sound.items()]
        for _ in range(chance.randrange(1, 4)):
            place = chance.randrange(len(pairs))
            name = pairs[place].partition(":")[0]
            pairs[place] = f"{name}: {chance.choice(values)}"
        if chance.random() < 0.3:
            pairs.append(chance.choice(pairs))
        body = bytearray(f"{{{', '.join(pairs)}}}".encode())
        for _ in range(chance.choice((0, 0, 1, 3))):
            body[chance.randrange(len(body))] = chance.randrange(256)
        yield bytes(body)


def test_slightly_invalid_bodies_are_answered_as_documented(desk: Harness) -> None:
    print(f"seed {SEED}")
    chance, known = random.Random(SEED), documented()["POST", "/api/v1/jobs"]
    seen = set[int]()
    for _, body in zip(range(MUTANTS), mutants(chance), strict=False):
        answer = send(desk.app, "POST", "/api/v1/jobs?dry_run=true&predict=false", body)
        shown(answer)
        assert answer.status in known, (answer.status, body)
        seen.add(answer.status)
    assert {200, 422} <= seen
