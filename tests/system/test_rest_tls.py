"""REST over TLS with the rig's own certificates, over real sockets: keys work, and unknown
clients block nothing."""

import json
import socket
import ssl
import subprocess
import sys
from collections.abc import Generator
from contextlib import ExitStack
from pathlib import Path
from time import monotonic, sleep

import httpx
import pytest
import yaml

from pincette.cli import Exit
from pincette.cli.estop import SUPERVISOR as WAY
from pincette.client import NoAnswerError, ProblemError, Supervisor
from pincette.config import ConfigError
from pincette.security.folder import Folder
from pincette.security.identity import SUPERVISOR, program
from pincette_supervisor.access.access import Access
from pincette_supervisor.config import configure
from pincette_supervisor.rest.api import create_app
from pincette_supervisor.rest.connections import HANDSHAKE_S, MOST_PENDING, server_context
from tests.support.bare_connects import TLS_HELLO_BEGUN, descriptors
from tests.support.certificates import folder_for
from tests.support.commands import pincette
from tests.support.keys import key_of_each_scope
from tests.support.rigs import demo_rig, paced_rig
from tests.support.running import running_rig
from tests.support.served import connected, served
from tests.unit.supervisor.harness import Harness

ROOT = Path(__file__).resolve().parents[2]
ESTOP_S = 0.5
STRANGERS = 400
BACK_S = 30.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    return folder_for(tmp_path_factory.mktemp("certificates") / "pki", "demo")


@pytest.fixture
def authority(folder: Folder) -> Path:
    return folder.path / "authority.crt"


@pytest.fixture
def desk(tmp_path: Path) -> Generator[Harness]:
    made = Harness(demo_rig(time="lockstep"), tmp_path)
    yield made
    made.close()


@pytest.fixture
def context(folder: Folder) -> ssl.SSLContext:
    return server_context(folder.credentials(program(SUPERVISOR, "")))


def test_keys_work_over_tls_and_clients_of_another_authority_are_reported(
    desk: Harness, context: ssl.SSLContext, authority: Path, tmp_path: Path
) -> None:
    access = Access()
    ring = key_of_each_scope(desk.store, access.authenticator)
    with served(create_app(desk.rigs, access), tls=context) as address:
        assert address.startswith("https://")
        with Supervisor(address, key=ring.keys["observe"], authority=authority) as seeing:
            assert [rig.name for rig in seeing.rigs()] == ["demo"]
            with pytest.raises(ProblemError, match="needs scope operate"):
                seeing.rig().reset()
        with (
            Supervisor(address, authority=authority) as nobody,
            pytest.raises(ProblemError, match="requires a key"),
        ):
            nobody.rigs()
        other = folder_for(tmp_path / "other", "demo").path / "authority.crt"
        for believed in (None, other):
            begun_s = monotonic()
            with (
                Supervisor(address, authority=believed) as stranger,
                pytest.raises(NoAnswerError, match="name the certificate of the authority"),
            ):
                stranger.rigs()
            assert monotonic() - begun_s < 5.0, "a permanent error must not be retried"
        words = ["rigs", "--url", address, "--key", ring.keys["observe"]]
        assert pincette(*words, "--authority", authority).returncode == Exit.DONE
        assert pincette(*words).returncode == Exit.NO_ANSWER
        plain = address.replace("https", "http")
        reported = httpx.get(f"{plain}/livez", trust_env=False)
        assert (reported.status_code, "https://" in reported.text) == (400, True)


@pytest.mark.usefixtures("stalls")
@pytest.mark.parametrize("secure", [True], ids=["tls"])
def test_the_health_check_of_a_container_works_with_and_without_tls(
    desk: Harness, context: ssl.SSLContext, secure: bool
) -> None:
    composed = yaml.safe_load((ROOT / "docker-compose.yml").read_text(encoding="utf-8"))
    _, _, *words, script = composed["services"]["supervisor"]["healthcheck"]["test"]
    with served(create_app(desk.rigs, Access()), tls=context if secure else None) as address:
        requested = script.replace("127.0.0.1:8000", address.partition("://")[2])
        for ready in (True, False):
            if not ready:
                desk.bus.silent.add("sensor")
                desk.health.refresh(force=True)
            done = subprocess.run([sys.executable, *words, requested], check=False, timeout=30.0)
            assert (done.returncode == 0) == ready


def test_a_session_over_tls_has_a_cookie_for_tls_only(
    desk: Harness, context: ssl.SSLContext, authority: Path
) -> None:
    access = Access()
    ring = key_of_each_scope(desk.store, access.authenticator)
    with (
        served(create_app(desk.rigs, access), tls=context) as address,
        httpx.Client(
            base_url=address,
            verify=ssl.create_default_context(cafile=authority),
            trust_env=False,
        ) as client,
    ):
        page = {"Origin": address, "Sec-Fetch-Site": "same-origin"}
        answer = client.post("/api/v1/session", headers=ring.headers("operate") | page)
        assert answer.is_success
        assert "secure" in answer.headers["set-cookie"].lower()
        assert client.get("/api/v1/rigs").is_success
        assert client.get("/").is_success


@pytest.mark.usefixtures("stalls")
@pytest.mark.parametrize("words", [TLS_HELLO_BEGUN, b"GET / HTTP/1.1\r\n\r\n"])
def test_unknown_connections_without_a_handshake_block_no_client(
    desk: Harness,
    context: ssl.SSLContext,
    authority: Path,
    words: bytes,
    figures: list[str],
) -> None:
    trusted = ssl.create_default_context(cafile=authority)
    with served(create_app(desk.rigs, Access()), tls=context) as address, ExitStack() as held:
        before = descriptors()
        for _ in range(STRANGERS):
            held.enter_context(connected(address)).sendall(words)
        begun_s = monotonic()
        with httpx.Client(verify=trusted, trust_env=False, timeout=30.0) as client:
            answer = client.post(f"{address}/api/v1/rigs/demo/estop")
            took_s = monotonic() - begun_s
        assert answer.status_code == 200
        figures.append(f"estop over TLS past {STRANGERS} strangers: {1e3 * took_s:.0f} ms")
        assert took_s < ESTOP_S
        # The other ends of the connections belong to this process too.
        assert descriptors() <= before + STRANGERS + MOST_PENDING + 20
        deadline = monotonic() + HANDSHAKE_S + BACK_S
        while descriptors() > before + STRANGERS + 20:
            assert monotonic() < deadline
            sleep(0.05)


def test_data_sent_right_after_the_handshake_is_answered(
    desk: Harness, context: ssl.SSLContext, authority: Path
) -> None:
    trusted = ssl.create_default_context(cafile=authority)
    with served(create_app(desk.rigs, Access()), tls=context) as address:
        for _ in range(20):
            with (
                connected(address) as line,
                trusted.wrap_socket(line, server_hostname="127.0.0.1") as shaken,
            ):
                shaken.sendall(b"GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\n")
                assert shaken.recv(100).startswith(b"HTTP/1.1 200 ")
        with connected(address) as line:
            line.shutdown(socket.SHUT_RDWR)


def test_without_certificates_the_supervisor_does_not_start(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"\[bus\] pki names their folder"):
        configure(demo_rig({"supervisor": {"tls": True}}), tmp_path)


def test_one_line_of_the_rig_file_enables_tls(
    folder: Folder, authority: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PINCETTE_PKI", str(folder.path))
    rig = paced_rig({"supervisor": {"tls": True}}).secured(folder.path)
    with running_rig(rig, tmp_path) as running:
        with Supervisor(rig.supervisor.url, authority=authority) as supervisor:
            job = supervisor.rig().start("grip").wait(60.0)
            assert job.state == "succeeded"
        done = pincette("estop", "--json", "--rig", str(running.path))
        assert json.loads(done.stdout)["stopped"] == {"demo": WAY}
