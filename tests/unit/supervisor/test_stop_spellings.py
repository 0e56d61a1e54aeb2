"""An emergency stop acts for every spelling of its path and every version of HTTP.

Each request is sent as bytes to the supervisor's own HTTP server.
"""

import json
import tomllib
from collections.abc import Callable, Generator
from typing import Any

import pytest

from pincette.config import parse_rig
from pincette.config.reading import laid_over
from tests.support.rigs import DEMO
from tests.support.served import connected, served

from .harness import Harness

STOPS = (
    "/api/v1/rigs/demo/estop",
    "/api/v1/rigs/demo/estop/",
    "/api/v1/rigs/demo/estop//",
    "//api/v1/rigs/demo/estop",
    "/api//v1/rigs///demo/estop",
    "/api/v1/rigs/demo/%65stop",
    "/api/v1/rigs/demo%2Festop",
    "/api/v1/rigs/demo%2festop%2f",
    "/%61pi/v1/rigs/%64emo/estop",
    "/api/v1/rigs/demo/estop?by=me&by=you&dry_run=true",
    "/api/v1/rigs/demo/estop/?x",
    "/api/v1/rigs/demo/estop%3Fby=me",
    "/api/v1/rigs/demo/estop;jsessionid=1",
    "/api/v1/rigs/demo/estop%20",
    "/api/v1/rigs/demo/estop%0a",
    "/api/v1/./rigs/demo/../demo/estop",
    "/API/V1/Rigs/DEMO/EStop",
    "http://127.0.0.1:8000/api/v1/rigs/demo/estop",
    "HTTP://gripper.example/api/v1/rigs/demo/estop/",
    "/api/v1/estop",
    "/api/v1/estop/",
    "//api/v1//estop?",
    "http://127.0.0.1/api/v1/estop",
)
NO_STOPS = (
    "/api/v1/rigs/demo/estop/now",
    "/api/v1/rigs/demo/estops",
    "/api/v1/rigs//estop",
    "/api/v1/rigs/demo",
    "/estop",
    "/api/v2/estop",
    "/gripper/api/v1/estop",
    "/api/v1/rigs/demo/estop/page-check",
    "*",
)
HEADS = {
    "1.1": "HTTP/1.1\r\nHost: 127.0.0.1:8000\r\n",
    "1.1, foreign Host": "HTTP/1.1\r\nHost: evil.example\r\n",
    "1.1, impossible Host": "HTTP/1.1\r\nHost: [a b]:x\r\n",
    "1.1, empty Host": "HTTP/1.1\r\nHost: \r\n",
    "1.1, no Host": "HTTP/1.1\r\n",
    "1.1, two Hosts": "HTTP/1.1\r\nHost: a\r\nHost: b\r\n",
    "1.0": "HTTP/1.0\r\nHost: 127.0.0.1:8000\r\n",
    "1.0, no Host": "HTTP/1.0\r\n",
    "1.0, empty Host": "HTTP/1.0\r\nHost:\r\n",
    "no Host, with Origin": "HTTP/1.0\r\nOrigin: http://gripper.lab\r\n",
    "2": "HTTP/2\r\n",
    "no version": "\r\n",
    "invalid header": "HTTP/1.1\r\nHost: a\r\nno colon\r\n",
    "own page": "HTTP/1.1\r\nHost: gripper.lab\r\nOrigin: http://gripper.lab\r\n"
    "Sec-Fetch-Site: same-origin\r\n",
    "own page, TLS proxy that drops Host": "HTTP/1.1\r\nHost: 127.0.0.1:8000\r\n"
    "Origin: https://gripper.lab\r\nSec-Fetch-Site: same-origin\r\n",
    "own page, proxy that adds the port": "HTTP/1.1\r\nHost: gripper.lab:80\r\n"
    "Origin: http://gripper.lab\r\n",
    "wrong key": "HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer wrong\r\n"
    "Cookie: pincette_session=x\r\n",
    "form": "HTTP/1.1\r\nHost: a\r\nContent-Type: application/x-www-form-urlencoded\r\n"
    "Content-Length: 3\r\n\r\na=b",
    "broken JSON": "HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\n"
    "Content-Length: 1\r\n\r\n{",
    "announced body": "HTTP/1.1\r\nHost: a\r\nContent-Length: 999999999\r\n",
    "chunked, never sent": "HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n",
    "both lengths": "HTTP/1.1\r\nHost: a\r\nContent-Length: 2\r\nTransfer-Encoding: chunked\r\n",
    "unknown coding": "HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: gzip\r\n",
    "expects": "HTTP/1.1\r\nHost: a\r\nExpect: 100-continue\r\nContent-Length: 9\r\n",
    "upgrade": "HTTP/1.1\r\nHost: a\r\nConnection: Upgrade\r\nUpgrade: h2c\r\n",
    "line ends of Unix": "HTTP/1.1\nHost: a\n",
}
FOREIGN = (
    "Origin: http://evil.example",
    "Origin: null",
    "Sec-Fetch-Site: cross-site",
    "Sec-Fetch-Site: same-site",
)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Generator[str]:
    rig = laid_over(tomllib.loads(DEMO.read_text(encoding="utf-8")), {"rig": {"time": "lockstep"}})
    harness = Harness(parse_rig(rig), tmp_path_factory.mktemp("stops"))
    with served(harness.app) as place:
        yield place
    harness.close()


Exchange = Callable[[bytes], tuple[int, dict[str, str], bytes]]


@pytest.fixture(scope="module")
def exchange(address: str) -> Exchange:
    def send(data: bytes) -> tuple[int, dict[str, str], bytes]:
        with connected(address) as connection:
            connection.settimeout(10.0)
            connection.sendall(data)
            received = b""
            while b"\r\n\r\n" not in received and (more := connection.recv(65_536)):
                received += more
            head, _, body = received.partition(b"\r\n\r\n")
            first, *lines = head.decode("latin-1").split("\r\n")
            headers = {name.lower(): value for name, _, value in (x.partition(": ") for x in lines)}
            length = 0 if data.startswith(b"HEAD") else int(headers.get("content-length", 0))
            while len(body) < length:
                if not (more := connection.recv(65_536)):
                    break
                body += more
        return int(first.split()[1]), headers, body

    return send


@pytest.mark.parametrize("path", STOPS)
def test_a_stop_acts_for_every_spelling_of_its_path(exchange: Exchange, path: str) -> None:
    status, _, body = exchange(f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1:8000\r\n\r\n".encode())
    assert status == 200, body
    found: dict[str, Any] = json.loads(body)
    one = found["rigs"][0] if "rigs" in found else found
    assert (one["rig"], one["cause"], one["acknowledged"]) == ("demo", "estop", True)


@pytest.mark.parametrize("head", HEADS.values(), ids=HEADS)
@pytest.mark.parametrize("path", ["/api/v1/rigs/demo/estop", "/api/v1/estop/"])
def test_a_stop_acts_with_any_request_headers(exchange: Exchange, path: str, head: str) -> None:
    end = "" if "\r\n\r\n" in head else "\n" if "\r" not in head else "\r\n"
    status, _, body = exchange(f"POST {path} {head}{end}".encode())
    assert status == 200, body
    assert b'"acknowledged":true' in body


@pytest.mark.parametrize("path", NO_STOPS)
def test_other_paths_than_that_of_the_stop_give_an_error_and_no_redirect(
    exchange: Exchange, path: str
) -> None:
    status, headers, body = exchange(f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
    assert status in (404, 405)
    assert headers["content-type"] == "application/problem+json"
    assert json.loads(body)["status"] == status


def test_a_stop_of_an_unknown_rig_names_the_rigs(exchange: Exchange) -> None:
    status, _, body = exchange(b"POST /api/v1/rigs/other/estop/ HTTP/1.0\r\n\r\n")
    assert status == 404
    assert "demo" in json.loads(body)["detail"]


@pytest.mark.parametrize("method", ["GET", "HEAD", "PUT", "DELETE", "PATCH", "TRACE", "stop"])
def test_no_other_http_method_stops_the_rig(exchange: Exchange, method: str) -> None:
    head = f"{method} /api/v1/rigs/demo/estop HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    status, headers, _ = exchange(head.encode())
    assert status == 405
    assert set(headers["allow"].split(", ")) == {"POST", "OPTIONS"}


def test_the_method_post_in_lower_case_stops_the_rig(exchange: Exchange) -> None:
    assert exchange(b"post /api/v1/estop HTTP/1.1\r\nHost: a\r\n\r\n")[0] == 200


@pytest.mark.parametrize("line", FOREIGN)
@pytest.mark.parametrize("host", ["127.0.0.1:8000", "gripper.lab"])
def test_a_page_of_another_site_stops_nothing(exchange: Exchange, line: str, host: str) -> None:
    head = f"POST /api/v1/estop/ HTTP/1.1\r\nHost: {host}\r\n{line}\r\n\r\n"
    status, headers, _ = exchange(head.encode())
    assert (status, headers["content-type"]) == (403, "application/problem+json")


@pytest.mark.parametrize("line", FOREIGN)
@pytest.mark.parametrize("length", [15_000, 17_000])
@pytest.mark.parametrize("host", ["", "Host: 127.0.0.1\r\n"])
def test_an_invalid_request_head_does_not_stop_the_rig(
    exchange: Exchange, line: str, length: int, host: str
) -> None:
    head = f"POST /api/v1/estop?{'x' * length} HTTP/1.1\r\n{host}{line}\r\n\r\n"
    assert exchange(head.encode())[0] in (400, 403)


def test_other_requests_without_host_are_refused(exchange: Exchange) -> None:
    assert exchange(b"GET /api/v1/rigs HTTP/1.1\r\n\r\n")[0] == 400
    for head in (b"HTTP/1.0\r\n", b"HTTP/1.1\r\nHost:\r\n", b"HTTP/1.1\r\nHost: evil\r\n"):
        for line in (b"GET / ", b"GET /api/v1/rigs ", b"GET /openapi.json ", b"POST /api/v1/jobs "):
            status, headers, _ = exchange(line + head + b"\r\n")
            assert (status, headers["content-type"]) == (421, "application/problem+json")


def test_the_host_in_an_absolute_request_target_is_checked(exchange: Exchange) -> None:
    own = b"GET http://127.0.0.1:8000/api/v1/rigs HTTP/1.1\r\nHost: evil.example\r\n\r\n"
    other = b"GET http://evil.example/api/v1/rigs HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    assert exchange(own)[0] == 200
    assert exchange(other)[0] == 421


@pytest.mark.parametrize("path", ["/livez", "/readyz"])
@pytest.mark.parametrize("method", ["GET", "HEAD", "OPTIONS"])
def test_probes_answer_every_client(exchange: Exchange, path: str, method: str) -> None:
    for head in ("HTTP/1.0\r\n", "HTTP/1.1\r\nHost: evil\r\n", "HTTP/1.1\r\nHost:\r\n"):
        status, _, body = exchange(f"{method} {path} {head}\r\n".encode())
        assert status in (200, 204, 503)
        assert (body == b"") == (method != "GET")


def test_the_default_check_of_haproxy_is_answered(exchange: Exchange) -> None:
    status, headers, _ = exchange(b"OPTIONS / HTTP/1.0\r\n\r\n")
    assert (status, headers["allow"]) == (204, "GET, HEAD, OPTIONS")
    assert exchange(b"OPTIONS * HTTP/1.1\r\nHost: a\r\n\r\n")[0] == 204


def test_several_stops_on_one_connection_act(address: str) -> None:
    one = b"POST /api/v1/rigs/demo/estop/ HTTP/1.1\r\nHost: a\r\n\r\n"
    with connected(address) as connection:
        connection.settimeout(10.0)
        for _ in range(3):
            connection.sendall(one)
            received = b""
            while b"acknowledged" not in received:
                received += connection.recv(65_536)
            assert received.startswith(b"HTTP/1.1 200")
