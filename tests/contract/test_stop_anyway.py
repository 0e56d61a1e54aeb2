"""`pincette estop` stops the rig whatever is missing or damaged, and reports what was confirmed."""

import json
import os
import re
import socket
import ssl
import subprocess
import sys
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from time import monotonic
from typing import Any

import pytest

from pincette.bus.endpoints import service_endpoint
from pincette.bus.zenoh_bus import ZenohBus
from pincette.cli import Exit
from pincette.cli import estop as estop_command
from pincette.cli.main import main
from pincette.config import RigFile
from pincette.core import rest_stop
from pincette.core.messages import Ack, Message
from pincette.core.topics import TRIP, Request
from pincette.engine.process import loop_services
from pincette.security.folder import Folder
from pincette.security.identity import program
from tests.support.answering import Answering, answering, stopped
from tests.support.certificates import DAYS, NOW
from tests.support.commands import processor_ratio
from tests.support.rigs import demo_rig, rig_toml

NOBODY = 54321
"""A user id without an entry in the list of accounts."""
RATIO = 18.0
"""Upper bound of the processor time of a stop, in multiples of that of an empty Python program."""
Environment = dict[str, str]


def estop(
    *words: str,
    env: Environment | None = None,
    cwd: Path | None = None,
    other_account: bool = False,
    before: Callable[[], None] | None = None,
    **streams: Any,
) -> "subprocess.CompletedProcess[str]":
    """Run the command in a separate process, optionally under an account without an entry in the
    list of accounts."""
    account = ["unshare", "--user", f"--map-user={NOBODY}"] if other_account else []
    settings: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **streams}
    return subprocess.run(
        [*account, sys.executable, "-m", "pincette", "estop", *words],
        env={"HOME": "/nonexistent"} if env is None else env,
        cwd=cwd,
        preexec_fn=before,
        text=True,
        timeout=30.0,
        check=False,
        **settings,
    )


@pytest.fixture(scope="module")
def supervisor() -> Generator[Answering]:
    with answering(200, stopped("demo")) as found:
        yield found


def has_namespaces() -> bool:
    """Return whether this process can change its account within a user namespace."""
    words = ["unshare", "--user", f"--map-user={NOBODY}", "true"]
    return subprocess.run(words, capture_output=True, check=False).returncode == 0


def odd_environments(folder: Path) -> dict[str, dict[str, Any]]:
    """Return environments in which only things are missing that the stop does not need."""
    broken = folder / "broken.toml"
    broken.write_bytes(b"[rig\x00\xff")
    closed = folder / "closed"
    closed.mkdir()
    if os.geteuid() == 0:
        os.chown(closed, NOBODY, NOBODY)  # which is not an account of the namespace
    closed.chmod(0o000)
    gone = folder / "gone"
    gone.mkdir()
    key = folder / "key"
    key.write_bytes(b"\xff\xfe")
    fifo = folder / "fifo"
    os.mkfifo(fifo)
    unprotected = folder / "config" / "pincette" / "key"
    unprotected.parent.mkdir(parents=True)
    unprotected.write_text("secret")
    unprotected.chmod(0o644)
    plain: Environment = {"PATH": os.environ["PATH"]}
    nobody = {"other_account": has_namespaces()}

    def leave() -> None:
        gone.rmdir()

    return {
        "no HOME": {"env": {}},
        "HOME that may not be entered": {"env": plain | {"HOME": str(closed)}, **nobody},
        "account without an entry": {"env": plain, **nobody},
        "rig file that may not be read": {
            "env": plain | {"PINCETTE_RIG": str(closed / "rig.toml")},
            **nobody,
        },
        "damaged rig file": {"env": plain | {"PINCETTE_RIG": str(broken)}},
        "missing rig file": {"env": plain | {"PINCETTE_RIG": str(folder / "no.toml")}},
        "rig file is a folder": {"env": plain | {"PINCETTE_RIG": str(folder)}},
        "rig file is a pipe": {"env": plain | {"PINCETTE_RIG": str(fifo)}},
        "outside a checkout": {"env": plain, "cwd": Path("/")},
        "deleted folder": {"env": plain, "cwd": gone, "before": leave},
        "unreadable folder": {"env": {}, "cwd": closed},
        "broken key file": {"env": plain | {"PINCETTE_KEY": f"@{key}"}},
        "missing key file": {"env": plain | {"PINCETTE_KEY": f"@{folder / 'none'}"}},
        "unprotected key file": {"env": plain | {"XDG_CONFIG_HOME": str(folder / "config")}},
        "key that no header carries": {"env": plain | {"PINCETTE_KEY": "ü\nx"}},
        "malformed variables": {
            "env": plain
            | {
                "PINCETTE_CLAIM": "x",
                "PINCETTE_PKI": str(folder / "no-pki"),
                "PINCETTE_AUTHORITY": str(folder / "no-authority"),
                "PINCETTE_URL": "::::",
                "PINCETTE_LOG_FORMAT": "xml",
                "USER": "x" * 500,
            }
        },
        "bad locale": {"env": plain | {"LC_ALL": "xx_YY.nothing", "LANG": "\udcff"}},
        "full disk": {"env": plain, "stdout": "/dev/full", "stderr": "/dev/full"},
        "closed output": {"env": plain, "before": lambda: os.closerange(0, 3)},
    }


def test_everything_that_a_stop_does_not_need_is_optional(
    supervisor: Answering, tmp_path: Path
) -> None:
    """Each variant is a process; a few at a time, since each takes half a second."""

    def run(entry: tuple[str, dict[str, Any]]) -> tuple[str, Any]:
        name, how = entry
        streams = {
            which: Path(how[which]).open("w")  # noqa: SIM115
            for which in ("stdout", "stderr")
            if which in how
        }
        words = ["--url", supervisor.url]
        try:
            given: dict[str, Any] = {**how, **streams}
            return name, estop(*words, **given)
        finally:
            for stream in streams.values():
                stream.close()

    supervisor.posts.clear()
    variants = odd_environments(tmp_path)
    with ThreadPoolExecutor(4) as threads:
        ended = dict(threads.map(run, variants.items()))
    (tmp_path / "closed").chmod(0o755)
    failed = {
        name: (one.returncode, one.stdout, one.stderr)
        for name, one in ended.items()
        if one.returncode != Exit.DONE or "Traceback" in (one.stderr or "")
    }
    assert failed == {}
    assert [path for path, _ in supervisor.posts] == ["/api/v1/estop"] * len(variants)


@pytest.mark.parametrize(
    ("status", "body"),
    [
        (200, None),
        (200, b"<html>welcome</html>"),
        (200, {"rigs": []}),
        (200, {"rigs": [{"rig": "demo", "cause": "estop", "acknowledged": False}]}),
        (307, b""),
        (404, {"title": "Not found"}),
        (500, b"oops"),
    ],
    ids=str,
)
def test_the_answer_of_another_program_confirms_nothing(
    status: int, body: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    with answering(status, body) as other:
        ended = main(["estop", "--url", other.url, "--rig", "/nonexistent", "--json"])
    assert ended == Exit.NO_ANSWER
    output = json.loads(capsys.readouterr().out)
    assert output["stopped"] == {}
    assert output["unconfirmed"]


def test_rigs_that_have_not_confirmed_are_named_and_the_exit_status_shows_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    problem = {
        "type": "urn:pincette:problem:estop-unconfirmed",
        "title": "Not every rig has confirmed the emergency stop",
        "stopped": ["left"],
        "unconfirmed": ["right"],
    }
    with answering(503, problem) as supervisor:
        ended = main(["estop", "--url", supervisor.url, "--rig", "/nonexistent", "--json"])
    assert ended == Exit.FAILED
    output = json.loads(capsys.readouterr().out)
    assert output["stopped"] == {"left": "through the supervisor"}
    assert "right" in output["unconfirmed"]


def test_one_rig_is_stopped_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    (entry,) = stopped("right")["rigs"]
    with answering(200, entry) as supervisor:
        words = ["--url", supervisor.url, "--rig", "/nonexistent", "--rig-name", "right"]
        assert main(["estop", *words]) == Exit.DONE
        assert supervisor.posts[0][0] == "/api/v1/rigs/right/estop"
        assert main(["estop", *words[:-1], "left"]) != Exit.DONE  # the reply names another rig
    assert "rig right: stopped" in capsys.readouterr().out


@pytest.mark.parametrize("proven", [False, True])
def test_a_key_is_sent_only_if_a_certificate_proves_the_server_and_is_omitted_if_refused(
    proven: bool, tmp_path: Path
) -> None:
    """Any program may have taken the port. A proxy may refuse a key, which a stop does not need."""
    folder = Folder(tmp_path / "pki")
    folder.begin(NOW, DAYS)
    institute = folder.issue(program("supervisor", ""), ("127.0.0.1",), NOW, DAYS)
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(institute.certificate, institute.private_key)
    words = ["--rig", "/nonexistent", "--key", "abc", "--authority", str(institute.authority)]
    with answering(401, {"title": "no"}, tls if proven else None) as proxy:
        main(["estop", "--url", proxy.url, *words])
    shown = [headers.get("Authorization") for _, headers in proxy.posts]
    assert shown == (["Bearer abc", None] if proven else [None])


@pytest.fixture
def actuator(tmp_path: Path) -> Generator[tuple[RigFile, Path, list[Message]]]:
    """An actuator on the bus that confirms every trip; there is no router and no supervisor."""
    rig, requested = demo_rig(), list[Message]()
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    bus = ZenohBus(service_endpoint(rig, "actuator", loop_services()), "demo", "actuator")

    def answer(_question: Request, message: Message, reply: Callable[[Any], None]) -> None:
        requested.append(message)
        reply(Ack(1))

    bus.serve(TRIP, answer)
    yield rig, path, requested
    bus.close()


def test_without_router_and_supervisor_the_actuator_is_stopped_directly(
    actuator: tuple[RigFile, Path, list[Message]], tmp_path: Path
) -> None:
    _, path, requested = actuator
    begun_s = monotonic()
    done = estop("--rig", str(path), "--json", env={}, cwd=tmp_path)
    took_s = monotonic() - begun_s
    assert done.returncode == Exit.DONE, done.stderr
    output = json.loads(done.stdout)
    assert output["stopped"] == {"demo": "at the actuator"}
    assert len(requested) == 1
    # The time is counted from the start of the process, which the system states in ticks of 10 ms,
    # and not from the end of its imports.
    assert 0.4 * took_s < output["elapsed_ms"] / 1e3 < took_s + 0.02


def test_a_stop_needs_little_more_processor_time_than_python_itself(
    actuator: tuple[RigFile, Path, list[Message]],
) -> None:
    assert processor_ratio("estop", "--rig", str(actuator[1])) < RATIO


def test_an_unrelated_fault_in_the_rig_file_does_not_prevent_a_stop(
    actuator: tuple[RigFile, Path, list[Message]],
) -> None:
    _, path, requested = actuator
    text = re.sub("(?m)^voltage_max_V = .*", "voltage_max_V = 'high'", path.read_text())
    text = text.replace("[bus]", "[bus]\nfrom_a_later_version = true", 1)
    path.write_text(f"{text}\n[no_such_table]\nx = 1\n", encoding="utf-8")
    done = estop("--rig", str(path), "--json")
    assert done.returncode == Exit.DONE, done.stderr
    assert len(requested) == 1


def test_a_hanging_supervisor_does_not_delay_the_direct_stop(
    actuator: tuple[RigFile, Path, list[Message]],
) -> None:
    _, path, requested = actuator
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"http://127.0.0.1:{silent.getsockname()[1]}"
        begun_s = monotonic()
        done = estop("--rig", str(path), "--url", url, "--rig-name", "demo", "--json")
    assert done.returncode == Exit.DONE, done.stderr
    assert len(requested) == 1
    assert json.loads(done.stdout)["elapsed_ms"] < 1e3 * (monotonic() - begun_s)


def test_a_late_confirmation_is_accepted(
    actuator: tuple[RigFile, Path, list[Message]],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As on a machine under heavy load, where even the rig file is read only after the limit."""
    _, path, requested = actuator
    late = Event()
    chosen, written = estop_command.chosen, estop_command.written

    def chosen_late(rig: Path | None) -> Path:
        assert late.wait(10.0), "the limit has not been reported"
        return chosen(rig)

    def written_first(stream: Any, write: Callable[[], object]) -> None:
        written(stream, write)
        late.set()

    monkeypatch.setattr(estop_command, "LIMIT_S", 0.01)
    monkeypatch.setattr(estop_command, "chosen", chosen_late)
    monkeypatch.setattr(estop_command, "written", written_first)
    assert main(["estop", "--rig", str(path), "--json"]) == Exit.DONE
    output = capsys.readouterr()
    assert "not confirmed within 0.01 s" in output.err
    assert json.loads(output.out)["stopped"] == {"demo": "at the actuator"}
    assert len(requested) >= 1


def _with_supervisor_at(path: Path, port: int) -> None:
    text = path.read_text(encoding="utf-8")
    head, table, rest = text.partition("[supervisor]\n")
    rest = re.sub(r"(?m)^port = \d+$", f"port = {port}", rest, count=1)
    path.write_text(head + table + rest, encoding="utf-8")


def test_an_impostor_at_the_port_of_the_supervisor_does_not_replace_the_actuator(
    actuator: tuple[RigFile, Path, list[Message]],
) -> None:
    _, path, requested = actuator
    with answering(200, stopped("demo")) as impostor:
        _with_supervisor_at(path, impostor.port)
        done = estop("--rig", str(path), "--json")
    assert done.returncode == Exit.DONE, done.stderr
    assert json.loads(done.stdout)["stopped"] == {"demo": "at the actuator"}
    assert len(requested) >= 1
    assert impostor.posts


def test_an_impostor_cannot_confirm_the_stop_of_a_missing_rig(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(demo_rig()), encoding="utf-8")
    with answering(200, stopped("demo")) as impostor:
        _with_supervisor_at(path, impostor.port)
        done = estop("--rig", str(path), "--json")
        by_url = estop("--rig", str(path), "--url", impostor.url.replace("127.0.0.1", "localhost"))
    assert done.returncode == by_url.returncode == Exit.NO_ANSWER
    output = json.loads(done.stdout)
    assert (output["stopped"], output["unconfirmed"]) == ({}, ["demo"])
    assert len(impostor.posts) == 2


def test_a_program_of_another_user_confirms_nothing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    with answering(200, stopped("demo")) as server:
        for uid, believed in ((0, True), (999, True), (1001, False), (65534, True)):

            def owner(_host: str, _port: int, uid: int = uid) -> int:
                return uid

            monkeypatch.setattr(rest_stop, "listener_uid", owner)
            status = main(["estop", "--url", server.url, "--rig", "/nonexistent", "--json"])
            assert status == (Exit.DONE if believed else Exit.NO_ANSWER)
            assert json.loads(capsys.readouterr().out)["stopped"].keys() == (
                {"demo"} if believed else set()
            )


@pytest.mark.parametrize("words", [("stop",), ("job", "list")], ids=" ".join)
def test_other_commands_than_stop_do_not_need_a_home_folder_either(words: tuple[str, ...]) -> None:
    account = ["unshare", "--user", f"--map-user={NOBODY}"] if has_namespaces() else []
    url = {"PATH": os.environ["PATH"], "PINCETTE_URL": "http://127.0.0.1:1"}
    done = subprocess.run(
        [*account, sys.executable, "-m", "pincette", *words],
        env=url,
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert done.returncode == Exit.NO_ANSWER
    assert "Traceback" not in done.stderr
    assert "no supervisor answers" in done.stderr
