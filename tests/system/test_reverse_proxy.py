"""A rig behind real reverse proxies, configured by the blocks of docs/how-to/reverse-proxy.md."""

import os
import re
import shutil
import ssl
import subprocess
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from urllib.parse import urljoin

import httpx
import pytest
from playwright.sync_api import Browser, expect

from pincette.client import Supervisor
from pincette.security.folder import Folder
from pincette.security.identity import SUPERVISOR, Credentials, program
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.rest.api import create_app
from tests.support.certificates import DAYS, NOW
from tests.support.documents import ROOT, blocks_of
from tests.support.keys import ScopeKeys, key_of_each_scope
from tests.support.rigs import demo_rig, free_ports, paced_rig
from tests.support.running import RunningRig, running_rig
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

PAGE = ROOT / "docs" / "how-to" / "reverse-proxy.md"
PATH = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin"])
OWN = {"Host": "gripper.lab", "Origin": "http://gripper.lab"}
START_S = 30.0
FIRST_EVENT_S = 5.0
ADDRESS = re.compile(r'(?:href|src|action)="([^"#?:]+)"')


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    changes = {"supervisor": {"names": ["gripper.lab"]}}
    with running_rig(paced_rig(changes), tmp_path_factory.mktemp("proxied")) as running:
        yield running


def nginx(block: str, folder: Path, port: int, tls: Credentials | None) -> tuple[list[str], str]:
    site = re.sub(r" +ssl_certificate.*\n", "", block)
    listen = f"listen 127.0.0.1:{port};"
    if tls is not None:
        listen = (
            f"listen 127.0.0.1:{port} ssl http2; ssl_certificate {tls.certificate}; "
            f"ssl_certificate_key {tls.private_key};"
        )
    site = re.sub(r"listen \d+( ssl)?;", listen, site)
    places = "".join(
        f"{name}_temp_path {folder}/{name};\n"
        for name in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    )
    text = (
        f"daemon off; master_process off; pid {folder}/pid; error_log stderr;\n"
        f"events {{}}\nhttp {{\naccess_log off;\n{places}{site}}}\n"
    )
    return ["nginx", "-e", "stderr", "-c", str(folder / "configuration")], text


def haproxy(block: str, folder: Path, port: int, tls: Credentials | None) -> tuple[list[str], str]:
    bind = f"bind 127.0.0.1:{port}"
    if tls is not None:
        (shown,) = re.findall(r"`bind :443( ssl crt )\S+( .+?)`", PAGE.read_text(encoding="utf-8"))
        bundle = folder / "gripper.lab.pem"
        bundle.write_bytes(tls.certificate.read_bytes() + tls.private_key.read_bytes())
        bind += f"{shown[0]}{bundle}{shown[1]}"
    text = block.replace("bind :80", bind)
    # One failed check takes the server down, so that a test need not wait for the usual three.
    text = text.replace(" check\n", " check inter 100ms fall 1\n")
    return ["haproxy", "-db", "-f", str(folder / "configuration")], text


def caddy(block: str, folder: Path, port: int, _tls: Credentials | None) -> tuple[list[str], str]:
    text = "{\n admin off\n}\n" + block.replace("http://gripper.lab", f"http://gripper.lab:{port}")
    name = str(folder / "configuration")
    return ["caddy", "run", "--adapter", "caddyfile", "--config", name], text


Prepare = Callable[[str, Path, int, Credentials | None], tuple[list[str], str]]
PROXIES: dict[str, Prepare] = {"nginx": nginx, "HAProxy": haproxy, "Caddy": caddy}
TITLES = {f"{name}: {kind}": name for name in PROXIES for kind in ("whole host", "prefix")}


def block_of(title: str) -> str:
    (block,) = [block for block in blocks_of(PAGE) if block.first == f"# {title}"]
    return block.text


@contextmanager
def proxied(
    title: str,
    url: str,
    folder: Path,
    change: Callable[[str], str] = str,
    tls: Credentials | None = None,
) -> Generator[httpx.Client]:
    """Return a client of a proxy in front of a supervisor, configured by a block of the page."""
    port = free_ports(1)
    block = change(block_of(title)).replace("127.0.0.1:8000", url.partition("//")[2])
    command, text = PROXIES[TITLES[title]](block, folder, port, tls)
    program = shutil.which(command[0], path=PATH)
    if program is None:
        pytest.skip(f"no {command[0]} on this machine")
    (folder / "configuration").write_text(text, encoding="utf-8")
    environment = {**os.environ, "HOME": str(folder), "XDG_DATA_HOME": str(folder)}
    log = (folder / "log").open("w")
    process = subprocess.Popen([program, *command[1:]], stdout=log, stderr=log, env=environment)
    try:
        scheme = "http" if tls is None else "https"
        base = f"{scheme}://127.0.0.1:{port}/" + ("gripper/" if title.endswith("prefix") else "")
        verify = True if tls is None else ssl.create_default_context(cafile=str(tls.authority))
        headers = OWN if tls is None else {}
        with httpx.Client(
            base_url=base, headers=headers, timeout=30.0, trust_env=False, verify=verify
        ) as client:
            until_answered(client, process, folder / "log")
            yield client
    finally:
        process.terminate()
        process.wait(10.0)
        log.close()


def until_answered(client: httpx.Client, process: subprocess.Popen[bytes], log: Path) -> None:
    deadline = monotonic() + START_S
    while True:
        assert process.poll() is None, log.read_text()
        try:
            if client.get("livez").status_code == 200:
                return
        except httpx.TransportError:
            pass
        assert monotonic() < deadline, log.read_text()
        sleep(0.05)


def assert_the_page_loads(client: httpx.Client) -> None:
    deadline = monotonic() + START_S
    page = client.get("")
    # After late health checks on a busy machine the proxy uses the server again.
    while page.status_code == 503 and monotonic() < deadline:
        sleep(0.2)
        page = client.get("")
    assert page.status_code == 200
    found = [address for address in ADDRESS.findall(page.text) if "{" not in address]
    assets = [address for address in found if "page/" in address]
    assert len(assets) >= 4
    for address in found:
        # A browser resolves them against the address of the page, including the prefix.
        place = urljoin(str(client.base_url), address)
        assert place.startswith(str(client.base_url)), address
        if address in assets:
            assert client.get(place).status_code == 200, address


@pytest.mark.parametrize("title", TITLES)
def test_a_rig_works_behind_a_proxy(title: str, rig: RunningRig, tmp_path: Path) -> None:
    with proxied(title, rig.rig.supervisor.url, tmp_path) as client:
        assert_the_page_loads(client)
        check = client.post("api/v1/rigs/demo/page-check").json()
        assert (check["stop"]["accepted"], check["order"]["accepted"]) == (True, True)
        assert check["path"] == "/api/v1/rigs/demo/page-check"

        taken = client.post("api/v1/jobs", json={"kind": "grip"})
        assert taken.status_code == 201
        job = urljoin(str(taken.request.url), taken.headers["location"])
        assert client.get(job).json()["id"] == taken.json()["id"]
        assert client.post(f"{job}/actions", json={"type": "stop"}).status_code == 202
        assert client.head(job).status_code == 200

        if "Caddy" not in title:  # which serves only a name that no DNS knows here
            with Supervisor(str(client.base_url)) as supervisor:
                assert [one.name for one in supervisor.rigs()] == [rig.rig.rig.name]

        begun_s = monotonic()
        with client.stream("GET", "api/v1/rigs/demo/live") as stream:
            assert next(stream.iter_text())
            assert monotonic() - begun_s < FIRST_EVENT_S

        if "HAProxy" in title:
            sleep(1.0)  # some checks later the server is still up
            assert client.get("livez").status_code == 200

        for path in ("api/v1/rigs/demo/estop", "api/v1/rigs/demo/estop/", "api/v1/estop"):
            stopped = client.post(path)
            assert stopped.status_code == 200, stopped.text
            assert stopped.json()["supervisor"] == check["supervisor"]
        assert rig.view()["latch"]["cause"] == "estop"
        reset = client.post("api/v1/rigs/demo/reset", json={"acknowledge": True})
        assert reset.status_code == 200, reset.text


def test_a_proxy_that_drops_host_is_reported(rig: RunningRig, tmp_path: Path) -> None:
    line = "proxy_set_header Host $http_host;"
    assert line in block_of("nginx: prefix")
    url = rig.rig.supervisor.url
    with proxied("nginx: prefix", url, tmp_path, lambda block: block.replace(line, "")) as client:
        assert client.get("api/v1/rigs").status_code == 200
        check = client.post("api/v1/rigs/demo/page-check").json()
        assert check["stop"]["code"] == check["order"]["code"] == "foreign-page"
        assert line in check["stop"]["remedy"]
        assert client.post("api/v1/rigs/demo/estop").status_code == 403


def test_a_prefix_that_a_proxy_did_not_remove_is_named(rig: RunningRig, tmp_path: Path) -> None:
    with proxied("nginx: whole host", rig.rig.supervisor.url, tmp_path) as client:
        answer = client.post("gripper/api/v1/rigs/demo/estop")
        assert answer.status_code == 404
        assert "'/gripper'" in answer.json()["detail"]


@dataclass(frozen=True)
class Desk:
    """A supervisor on plain HTTP that requires keys, with a simulated rig."""

    harness: Harness
    url: str
    keys: ScopeKeys


@pytest.fixture
def desk(tmp_path: Path) -> Generator[Desk]:
    harness = Harness(demo_rig(time="lockstep"), tmp_path / "data")
    access = Access(Authenticator(supervisor="s5"), names=frozenset({"gripper.lab"}))
    keys = key_of_each_scope(harness.store, access.authenticator)
    with served(create_app(harness.rigs, access)) as url:
        yield Desk(harness, url, keys)
    harness.close()


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Credentials:
    folder = Folder(tmp_path_factory.mktemp("authority") / "pki")
    folder.begin(NOW, DAYS)
    return folder.issue(program(SUPERVISOR, ""), ("gripper.lab", "127.0.0.1"), NOW, DAYS)


def place_of(client: httpx.Client) -> str:
    return str(client.base_url.copy_with(path="/")).rstrip("/")


@pytest.mark.parametrize("title", ["nginx: prefix", "HAProxy: whole host"])
def test_tls_may_end_at_the_proxy(
    title: str, desk: Desk, certificate: Credentials, tmp_path: Path
) -> None:
    with proxied(title, desk.url, tmp_path, tls=certificate) as client:
        assert_the_page_loads(client)
        shown, page = desk.keys.headers("operate"), {"Origin": place_of(client)}
        check = client.post("api/v1/rigs/demo/page-check", headers=shown | page).json()
        assert (check["stop"]["accepted"], check["order"]["accepted"]) == (True, True)

        for origin in (page, {}):  # of a page, and of a program behind X-Forwarded-Proto
            signed_in = client.post("api/v1/session", headers=shown | origin)
            assert signed_in.status_code == 200
            (cookie,) = signed_in.headers.get_list("set-cookie")
            name, _, attributes = cookie.partition("=")
            assert name == "__Host-pincette_session_s5"
            words = {part.strip().lower() for part in attributes.split(";")[1:]}
            assert words >= {"secure", "httponly", "samesite=strict", "path=/"}
        assert client.get("api/v1/session", headers=page).json()["signed_in"] is True
        assert client.get("api/v1/jobs", headers=page).status_code == 200

        for path in ("api/v1/rigs/demo/estop", "api/v1/rigs/demo/estop/", "api/v1/estop"):
            assert client.post(path, headers=page).status_code == 200
            assert desk.harness.bus.latch == "estop"
            desk.harness.bus.latch = ""


def test_a_cookie_over_plain_http_is_not_secure(desk: Desk, tmp_path: Path) -> None:
    with proxied("nginx: whole host", desk.url, tmp_path) as client:
        shown = desk.keys.headers("operate")
        (cookie,) = client.post("api/v1/session", headers=shown).headers.get_list("set-cookie")
        assert cookie.startswith("pincette_session_s5=")
        assert "secure" not in cookie.lower()


def test_a_browser_stops_the_rig_over_tls_and_http_2(
    desk: Desk, certificate: Credentials, tmp_path: Path, browser: Browser
) -> None:
    with proxied("nginx: prefix", desk.url, tmp_path, tls=certificate) as client:
        context = browser.new_context(ignore_https_errors=True)
        try:
            page = context.new_page()
            page.goto(str(client.base_url))
            protocol = page.evaluate(
                "performance.getEntriesByType('navigation')[0].nextHopProtocol"
            )
            assert protocol == "h2"
            expect(page.locator("#estop")).to_be_visible()
            page.locator("#estop").click()
            desk.harness.until(lambda: desk.harness.bus.latch == "estop")
        finally:
            context.close()
