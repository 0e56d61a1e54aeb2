"""The compose file and the image run the programs there are, from pins that are the same."""

import re
import shutil
import socket
import subprocess
import tomllib
from pathlib import Path

import pytest

from pincette.config import parse_rig, read_rig
from pincette.runtime.fleet import ports
from pincette.runtime.priority import FIFO
from pincette.runtime.process import programs
from pincette.topics import LOOP

HOLDS_THE_NETWORK = "loopback"


@pytest.fixture(scope="module")
def compose(root: Path) -> str:
    return (root / "docker-compose.yml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def services(compose: str) -> dict[str, str]:
    """The text of each service, by its name."""
    part = re.split(r"^(?:services|volumes):\n", compose, flags=re.MULTILINE)[1]
    pieces = re.split(r"^  ([a-z]+):.*\n", part, flags=re.MULTILINE)[1:]
    return dict(zip(pieces[::2], pieces[1::2], strict=True))


def test_there_is_a_service_for_each_program(services: dict[str, str]) -> None:
    assert sorted(services) == sorted([*programs(), HOLDS_THE_NETWORK])
    for name in programs():
        assert f"command: [run, {name}" in services[name]
        assert "<<: *program" in services[name]


def test_health_is_asked_for_at_the_ports_of_the_rig_file(
    root: Path, services: dict[str, str]
) -> None:
    rig = read_rig(root / "deploy/rigs/demo.toml")
    for port, purpose in ports(rig).items():
        name = "rig" if purpose.startswith("simulated") else purpose
        assert re.search(rf"\b{port}\b", services[name]), f"{name} does not look at {port}"


def test_nothing_is_published_beyond_this_machine(compose: str, services: dict[str, str]) -> None:
    assert re.findall(r"ports: (.*)", compose) == ['["127.0.0.1:8000:8000"]']
    assert "ports:" in services[HOLDS_THE_NETWORK]


def test_what_ticks_may_be_given_its_fixed_priority(root: Path) -> None:
    over = (root / "deploy/real-time.yml").read_text(encoding="utf-8")
    assert f"  router: &ticks\n    ulimits: {{ rtprio: {FIFO} }}\n" in over
    given = re.findall(r"^  (\w+): [&*]ticks$", over, re.MULTILINE)
    assert sorted(given) == sorted([*LOOP, "rig", "router"])


def test_records_go_into_one_volume(compose: str, services: dict[str, str]) -> None:
    assert compose.endswith("volumes:\n  data:\n")
    writing = {name for name, text in services.items() if "--data, /data" in text}
    assert writing == {"recorder", "supervisor"}
    assert {name for name, text in services.items() if 'volumes: ["data:/data"]' in text} == writing


def test_one_service_builds_the_image(compose: str) -> None:
    assert compose.count("build:") == 1
    assert compose.count("image: pincette\n") == 2


def _ran(command: list[str], folder: Path) -> bool:
    return subprocess.run(command, cwd=folder, capture_output=True, check=False).returncode == 0


def test_the_files_are_valid(root: Path) -> None:
    if shutil.which("docker") is None or not _ran(["docker", "compose", "version"], root):
        # An engine may come without this plug-in; what else the file must be is tested without it.
        pytest.skip("no docker compose here: its files are not validated")
    for over in ([], ["-f", "docker-compose.yml", "-f", "deploy/real-time.yml"]):
        command = ["docker", "compose", *over, "config", "--quiet"]
        done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ["run", "build"])
def test_the_image_is_filled_from_the_pins_that_are_tested(root: Path, name: str) -> None:
    def pins(file: str) -> set[str]:
        text = (root / "requirements" / file).read_text(encoding="utf-8")
        return {line.rstrip(" \\") for line in text.splitlines()}

    used = pins(f"{name}.txt")
    assert len(used) > 5
    assert used - pins("dev.txt") == set()
    assert f"--require-hashes -r requirements/{name}.txt" in (root / "deploy/Dockerfile").read_text(
        encoding="utf-8"
    )


def test_the_image_listens_where_compose_publishes(root: Path) -> None:
    rig = (root / "deploy/rigs/demo.toml").read_text(encoding="utf-8")
    assert re.search(r'^\[supervisor\]\nhost = "127\.0\.0\.1"\nport = 8000$', rig, re.MULTILINE)


def test_the_rig_file_of_the_image_promises_what_compose_keeps(root: Path, compose: str) -> None:
    text = (root / "deploy/rigs/demo.toml").read_text(encoding="utf-8")
    script = (root / "deploy/Dockerfile").read_text(encoding="utf-8")
    (change,) = re.findall(r"sed -i '([^']+)'", script)
    command = ["sed", change]
    made = subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout
    supervisor = parse_rig(tomllib.loads(made)).supervisor
    assert (supervisor.host, supervisor.behind) == ("0.0.0.0", "container")
    assert parse_rig(tomllib.loads(text)).supervisor.behind == "nothing"
    assert '"127.0.0.1:8000:8000"' in compose


def test_listens(root: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert subprocess.call([root / "deploy/listens", str(port)]) == 0
    assert subprocess.call([root / "deploy/listens", str(port)]) == 1
