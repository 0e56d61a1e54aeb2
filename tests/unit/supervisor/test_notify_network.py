"""Webhooks and mail behind a real forward proxy, and to receivers of a private authority."""

import base64
import json
import ssl
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pincette.config.notify import Mail, Webhook
from pincette.security.folder import Folder
from pincette.security.identity import SUPERVISOR, Credentials, program
from pincette_supervisor.notify import (
    MailSender,
    Notice,
    RefusedError,
    WebhookSender,
    proxy_of,
)
from tests.support.certificates import DAYS, NOW
from tests.support.forward_proxy import NAME, ForwardProxy, forward_proxy, objection, over_tls
from tests.support.receivers import Received, http_receiver, smtp_receiver
from tests.support.rigs import free_ports

SECRET = "whsec_" + base64.b64encode(bytes(range(32))).decode()
NOTICE = Notice(7, "alarm.raised", "2026-11-27T12:00:00Z", "demo: disk", {"rig": "demo"})
VARIABLES = ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "NO_PROXY", "SSL_CERT_FILE", "SSL_CERT_DIR")


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)


@pytest.fixture(scope="module")
def institute(tmp_path_factory: pytest.TempPathFactory) -> Credentials:
    """Files of a server whose certificate a private authority has signed."""
    folder = Folder(tmp_path_factory.mktemp("authority") / "pki")
    folder.begin(NOW, DAYS)
    return folder.issue(program(SUPERVISOR, ""), (NAME, "127.0.0.1"), NOW, DAYS)


@pytest.fixture(scope="module")
def authority(institute: Credentials) -> tuple[Path, ssl.SSLContext]:
    """The certificate of that authority, and the settings of that server."""
    served = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    served.load_cert_chain(institute.certificate, institute.private_key)
    return institute.authority, served


@contextmanager
def running_proxy(folder: Path, *ports: int, password: str = "") -> Generator[ForwardProxy]:
    reason = objection()
    if reason:
        pytest.skip(reason)
    with forward_proxy(folder, password=password, open_to=ports) as proxy:
        yield proxy


def post(url: str) -> None:
    WebhookSender(Webhook(url=url, secret_file="s"), SECRET).send(NOTICE)


def refusal(url: str) -> str:
    with pytest.raises(RefusedError) as raised:
        post(url)
    return str(raised.value)


def titles(received: Received) -> list[str]:
    return [json.loads(body)["data"]["title"] for _, body in received.posts]


@pytest.mark.parametrize("variable", ["http_proxy", "ALL_PROXY"])
def test_a_webhook_can_use_a_proxy(
    variable: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with running_proxy(tmp_path) as proxy, http_receiver() as received:
        url = f"http://{NAME}:{received.port}/hook"
        monkeypatch.setenv(variable, proxy.url)
        post(url)
        assert titles(received) == ["demo: disk"]
        assert "tinyproxy" in received.posts[0][0]["via"]
        assert proxy.requests() == [f"POST {url}"]


def test_a_secure_webhook_is_tunnelled_to_a_receiver_of_a_private_authority(
    authority: tuple[Path, ssl.SSLContext], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    certificate, served = authority
    with http_receiver(tls=served) as received, running_proxy(tmp_path, received.port) as proxy:
        url = f"https://{NAME}:{received.port}/hook"
        monkeypatch.setenv("HTTPS_PROXY", proxy.url.removeprefix("http://"))
        assert "SSL_CERT_FILE" in refusal(url)
        monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
        post(url)
        assert titles(received) == ["demo: disk"]
        assert proxy.requests() == [f"CONNECT {NAME}:{received.port}"] * 2


def test_a_proxy_may_be_reached_over_tls(
    institute: Credentials, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with (
        running_proxy(tmp_path) as proxy,
        over_tls(tmp_path, proxy, institute.certificate, institute.private_key) as address,
        http_receiver() as received,
    ):
        url = f"http://{NAME}:{received.port}/hook"
        monkeypatch.setenv("HTTP_PROXY", address)
        assert "SSL_CERT_FILE" in refusal(url)
        monkeypatch.setenv("SSL_CERT_FILE", str(institute.authority))
        post(url)
    assert titles(received) == ["demo: disk"]


@pytest.mark.parametrize("address", ["socks5://127.0.0.1:9", "ftp://127.0.0.1:9", "http://[:"])
def test_a_proxy_that_cannot_be_used_is_named(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ALL_PROXY", address)
    assert "ALL_PROXY" in refusal(f"https://{NAME}/hook")


def test_a_proxy_may_need_a_password(
    authority: tuple[Path, ssl.SSLContext], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    certificate, served = authority
    monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
    with (
        http_receiver(tls=served) as received,
        running_proxy(tmp_path, received.port, password="Kq7") as proxy,
    ):
        url = f"https://{NAME}:{received.port}/hook"
        monkeypatch.setenv("HTTPS_PROXY", proxy.url)
        assert "407" in refusal(url)
        monkeypatch.setenv("HTTPS_PROXY", f"http://user:Kq7@127.0.0.1:{proxy.port}")
        post(url)
    assert titles(received) == ["demo: disk"]


def test_a_refusal_names_the_proxy_without_its_password(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("HTTPS_PROXY", f"http://user:Kq7@127.0.0.1:{free_ports(1)}")
    nobody = refusal(f"https://{NAME}/hook")
    assert "HTTPS_PROXY" in nobody
    assert "127.0.0.1" in nobody
    assert "Kq7" not in nobody
    with running_proxy(tmp_path, 1) as proxy:  # which tunnels to no other port
        monkeypatch.setenv("HTTPS_PROXY", proxy.url)
        assert "403" in refusal(f"https://{NAME}/hook")


@pytest.mark.parametrize("names", ["127.0.0.1,0.0.0.0", "0.0.0.0/8"])
def test_receivers_in_the_no_proxy_variable_are_contacted_directly(
    names: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # Linux takes 0.0.0.0 for this machine, and it is no loopback address, for which no proxy is
    # asked in any case.
    with running_proxy(tmp_path) as proxy, http_receiver() as received:
        url = f"http://0.0.0.0:{received.port}/hook"
        monkeypatch.setenv("HTTP_PROXY", proxy.url)
        post(url)
        assert proxy.requests() == [f"POST {url}"]
        monkeypatch.setenv("NO_PROXY", names)
        post(url)
        assert len(proxy.requests()) == 1
    assert titles(received) == ["demo: disk"] * 2


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_no_proxy_is_used_for_a_receiver_on_this_machine(
    host: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HTTP_PROXY", f"http://127.0.0.1:{free_ports(1)}")
    with http_receiver() as received:
        post(f"http://{host}:{received.port}/hook")
    assert titles(received) == ["demo: disk"]


@pytest.mark.parametrize(
    ("url", "names", "direct"),
    [
        ("https://hub.lab/", "lab", True),
        ("https://hub.lab/", ".lab", True),
        ("https://hub.lab/", "*.lab", True),
        ("https://hub.lab/", "HUB.LAB", True),
        ("https://hub.lab:8443/", "hub.lab:8443", True),
        ("https://hub.lab/", "hub.lab:443", True),
        ("https://hub.lab:8443/", "hub.lab:443", False),
        ("https://hub.lab/", "b.lab", False),
        ("https://hub.lab/", "", False),
        ("https://10.1.2.3/", "10.0.0.0/8", True),
        ("https://10.1.2.3/", "10.1.0.0/16 , other", True),
        ("https://10.1.2.3/", "10.2.0.0/16", False),
        ("https://10.1.2.3/", "10.1.2.9/24", True),
        ("https://[fd00::7]/", "fd00::/8", True),
        ("https://[fd00::7]/", "fd00::7", True),
        ("https://[fd00::7]/", "[fd00::7]", True),
        ("https://[fd00::7]/", "fd01::/16,rubbish/x", False),
        ("https://[::1]/", "", True),
        ("https://127.9.9.9/", "", True),
    ],
)
def test_the_no_proxy_variable_is_parsed_as_in_other_programs(
    url: str, names: str, direct: bool
) -> None:
    proxies = {"HTTPS_PROXY": "http://proxy.lab:3128", "NO_PROXY": names}
    assert (proxy_of(url, proxies) is None) == direct


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_private_authority_is_trusted_for_webhooks_and_mail(
    kind: str,
    authority: tuple[Path, ssl.SSLContext],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    certificate, served = authority
    if kind == "file":
        monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
    else:
        (tmp_path / "institute.crt").write_bytes(certificate.read_bytes())
        subprocess.run(["openssl", "rehash", str(tmp_path)], check=True)
        monkeypatch.setenv("SSL_CERT_DIR", str(tmp_path))
    with http_receiver(tls=served) as received:
        post(f"https://127.0.0.1:{received.port}/hook")
    assert titles(received) == ["demo: disk"]
    with smtp_receiver(tls=served) as first, smtp_receiver(starttls=served) as second:
        mail_to(first.port, "tls")
        mail_to(second.port, "starttls")
    assert (len(first.mails), len(second.mails)) == (1, 1)


def mail_to(port: int, security: str) -> None:
    mail = Mail.model_validate(
        {
            "host": "127.0.0.1",
            "port": port,
            "security": security,
            "sender": "rig@laboratory.example",
            "to": ("ann@laboratory.example",),
        }
    )
    MailSender(mail, "").send(NOTICE)


def test_an_unknown_authority_is_refused_with_the_remedy(
    authority: tuple[Path, ssl.SSLContext],
) -> None:
    _, served = authority
    with http_receiver(tls=served) as received:
        assert "SSL_CERT_FILE" in refusal(f"https://127.0.0.1:{received.port}/hook")
    assert received.posts == []
    with smtp_receiver(tls=served) as first, smtp_receiver(starttls=served) as second:
        for received, security in ((first, "tls"), (second, "starttls")):
            with pytest.raises(RefusedError) as raised:
                mail_to(received.port, security)
            assert "SSL_CERT_FILE" in str(raised.value)
            assert received.mails == []


@pytest.mark.parametrize("content", [None, b"no certificate\n"])
def test_certificates_that_cannot_be_read_are_named(
    content: bytes | None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    place = tmp_path / "institute.pem"
    if content is not None:
        place.write_bytes(content)
    monkeypatch.setenv("SSL_CERT_FILE", str(place))
    assert str(place) in refusal("https://127.0.0.1:1/hook")
    with pytest.raises(RefusedError) as raised:
        mail_to(1, "tls")
    assert str(place) in str(raised.value)


def test_a_folder_of_certificates_that_is_invalid_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for place in (tmp_path / "missing", tmp_path):  # which has no certificate
        monkeypatch.setenv("SSL_CERT_DIR", str(place))
        assert str(place) in refusal("https://127.0.0.1:1/hook")


def test_a_certificate_of_another_host_is_refused_for_that_reason(
    authority: tuple[Path, ssl.SSLContext], monkeypatch: pytest.MonkeyPatch
) -> None:
    certificate, served = authority
    monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
    with http_receiver(tls=served) as received:
        words = refusal(f"https://localhost:{received.port}/hook")
    assert "localhost" in words
    assert received.posts == []
