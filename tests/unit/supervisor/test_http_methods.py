"""HEAD wherever there is GET, Allow with every 405, and OPTIONS."""

from typing import Any

from tests.support.api_document import openapi
from tests.support.served import connected, served

from .harness import Harness

FILES = ("/", "/favicon.ico", "/page/js/main.js", "/openapi.json", "/asyncapi.json")
WELL_KNOWN = "/.well-known/wot"
COUNTED = ("content-length", "etag", "last-modified")
"""Headers that may differ between two requests; the length differs where a body has a time."""


def paths(*methods: str) -> list[str]:
    tree: dict[str, Any] = openapi()["paths"]
    return [path for path, found in tree.items() if found.keys() & set(methods)]


def placed(path: str, job: str) -> str:
    names = {"rig": "demo", "job": job, "name": "manifest.json", "format": "json"}
    for name, value in names.items():
        path = path.replace(f"{{{name}}}", value)
    return path


def without_counts(headers: Any) -> dict[str, str]:
    return {name: value for name, value in headers.items() if name not in COUNTED}


def is_stream(path: str) -> bool:
    return path.endswith(("/events", "/live"))


def test_a_head_request_has_the_status_and_headers_of_get(harness: Harness) -> None:
    job = harness.ended(str(harness.grip(hold_s=0.1)["id"]))["id"]
    wanted = [path for path in paths("get") if not is_stream(path)]
    assert len(wanted) > 30
    for path in [*(placed(one, job) for one in wanted), *FILES, WELL_KNOWN]:
        get, head = harness.call("GET", path), harness.call("HEAD", path)
        assert head.status_code == get.status_code, path
        assert without_counts(head.headers) == without_counts(get.headers), path
        assert head.content == b"", path
    for name in ("samples.parquet", "samples.csv", "manifest.json"):
        path = f"/api/v1/jobs/{job}/artifacts/{name}"
        get, head = harness.call("GET", path), harness.call("HEAD", path)
        assert (head.status_code, head.content) == (get.status_code, b""), name
        assert head.headers == get.headers, name
    missing = harness.call("HEAD", f"/api/v1/jobs/{job}/artifacts/none")
    assert (missing.status_code, missing.content) == (404, b"")


def test_a_head_request_for_a_stream_ends_at_once(harness: Harness) -> None:
    job = str(harness.grip(hold_s=0.1)["id"])
    harness.ended(job)
    with served(harness.app) as address, connected(address) as connection:
        connection.settimeout(10.0)
        for path in [placed(one, job) for one in paths("get") if is_stream(one)]:
            connection.sendall(f"HEAD {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
            received = b""
            while not received.endswith(b"\r\n\r\n"):
                received += connection.recv(65_536)
            assert received.startswith(b"HTTP/1.1 200 "), path
            assert b"text/event-stream" in received, path
        assert harness.manager.context.live.open() is not None


def test_every_405_names_all_methods_of_its_path(harness: Harness) -> None:
    tree: dict[str, Any] = openapi()["paths"]
    for path, found in tree.items():
        place = placed(path, "20260301-120000-1f0c")
        has = {method.upper() for method in found}
        has |= {"OPTIONS", *(["HEAD"] if "GET" in has else [])}
        for method in {"GET", "POST", "PUT", "PATCH", "DELETE", "HEAD", "TRACE"} - has:
            refused = harness.call(method, place)
            if refused.status_code in (404, 422) and "{" not in path:
                continue  # /jobs/export.csv is also the place of a job of this name
            assert refused.status_code == 405, (method, place)
            allowed = set(refused.headers["allow"].split(", "))
            assert allowed >= has, (method, place)
            assert method not in allowed, (method, place)
            assert refused.headers["content-type"] == "application/problem+json"
            if method != "HEAD":
                assert refused.json()["type"] == "urn:pincette:problem:method-not-allowed"
        options = harness.call("OPTIONS", place)
        assert (options.status_code, options.content) == (204, b"")
        assert set(options.headers["allow"].split(", ")) >= has


def test_no_path_is_redirected(harness: Harness) -> None:
    every = [placed(path, "20260301-120000-1f0c") for path in paths("get", "post", "put")]
    for path in [*every, *FILES, WELL_KNOWN, "/page/", "/gripper/", "/none"]:
        for wrong in (f"{path}/", f"/{path}", f"{path}//x"):
            for method in ("GET", "POST"):
                if wrong.strip("/").lower().endswith("estop") and method == "POST":
                    continue
                answer = harness.call(method, f"http://localhost{wrong}")
                if answer.status_code != 200:
                    assert answer.status_code in (404, 405), (method, wrong)
                    assert answer.headers["content-type"] == "application/problem+json"


def test_an_options_request_for_an_unknown_path_is_refused(harness: Harness) -> None:
    assert harness.call("OPTIONS", "/none").status_code == 404


def test_a_prefix_that_a_proxy_did_not_remove_is_named(harness: Harness) -> None:
    answer = harness.call("POST", "/gripper/api/v1/rigs/demo/estop")
    assert answer.status_code == 404
    assert "'/gripper'" in answer.json()["detail"]
