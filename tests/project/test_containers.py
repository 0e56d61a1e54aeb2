"""The compose files run the existing programs, each with a health check, limits and no
privileges."""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any, cast

import pytest
import yaml

from pincette.bus.topology import endpoint
from pincette.config import read_rig
from pincette.core.topics import LOOP
from pincette.engine.fleet import ports
from pincette.engine.realtime.os_scheduling import FIFO
from tests.support.contained import PROFILES, contained

HOLDS_THE_NETWORK = "loopback"
OF_THE_LOOP = (*LOOP, "rig", "router")
"""Programs for which the image `pincette-loop` is made."""
OVERLAYS = ("listen", "offline", "real-rig", "real-time", "secure")
Tree = dict[str, Any]


def read(path: Path) -> Tree:
    return cast(Tree, yaml.safe_load(path.read_text(encoding="utf-8")))


@pytest.fixture(scope="module")
def compose(root: Path) -> Tree:
    return read(root / "docker-compose.yml")


@pytest.fixture(scope="module")
def every(compose: Tree) -> dict[str, Tree]:
    return cast(dict[str, Tree], compose["services"])


@pytest.fixture(scope="module")
def services(every: dict[str, Tree]) -> dict[str, Tree]:
    """Services that are up without a profile."""
    return {name: one for name, one in every.items() if "profiles" not in one}


def overlay(root: Path, name: str) -> dict[str, Tree]:
    return cast(dict[str, Tree], read(root / f"deploy/{name}.yml")["services"])


def test_each_program_has_a_service(services: dict[str, Tree]) -> None:
    assert sorted(services) == sorted([*contained(), HOLDS_THE_NETWORK])
    for name in contained():
        assert services[name]["command"][:2] == ["run", name]
        assert services[name]["network_mode"] == f"service:{HOLDS_THE_NETWORK}"


def test_every_container_has_limits_and_no_privileges(every: dict[str, Tree]) -> None:
    for name, service in every.items():
        assert service["read_only"] is True, name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert service["init"] is True, name
        # One container ends with the agent program that has started it.
        assert service["restart"] == ("no" if name == "agents" else "unless-stopped"), name
        assert re.fullmatch(r"\d+[mg]", service["mem_limit"]), name
        assert service["memswap_limit"] == service["mem_limit"], name
        assert 8 <= service["pids_limit"] <= 256, name
        assert not service.get("privileged"), name


def test_health_checks_exist_for_the_programs_of_the_rig_file(
    root: Path, services: dict[str, Tree]
) -> None:
    rig = read_rig(root / "deploy/rigs/demo.toml")
    wanted: dict[str, set[str]] = {}
    for port, purpose in ports(rig).items():
        name = "rig" if purpose.startswith("simulated") else purpose
        wanted.setdefault(name, set()).add(str(port))
    router = endpoint(rig.bus.host, rig.bus.port, "router").rpartition(":")[2]
    for name in set(contained()) - {"supervisor"}:
        requested = services[name]["healthcheck"]["test"]
        assert requested[:2] == ["CMD", "serves"]
        place = requested.index("--to") if "--to" in requested else len(requested)
        assert set(requested[2:place]) == wanted.get(name, set()), name
        assert requested[place:] == ([] if name == "router" else ["--to", router]), name
    assert f":{rig.supervisor.port}/readyz" in services["supervisor"]["healthcheck"]["test"][-1]


def test_programs_start_after_their_dependencies(services: dict[str, Tree]) -> None:
    for name in set(contained()) - {"router"}:
        assert services[name]["depends_on"]["router"] == {"condition": "service_healthy"}
    for name in ("sensor", "actuator"):
        rig = services[name]["depends_on"]["rig"]
        assert rig == {"condition": "service_healthy", "required": False}


def test_no_port_is_published_beyond_this_machine(root: Path, services: dict[str, Tree]) -> None:
    published = {name: one["ports"] for name, one in services.items() if "ports" in one}
    assert published == {HOLDS_THE_NETWORK: ["127.0.0.1:8000:8000"]}
    listening = overlay(root, "listen")
    assert listening[HOLDS_THE_NETWORK]["ports"] == [
        "${PINCETTE_PUBLISH:-127.0.0.1}:7447:7447",
    ]
    assert listening["router"]["environment"] == {"PINCETTE_LISTEN": "0.0.0.0"}


def test_a_profile_adds_a_server_and_its_port_and_nothing_else(every: dict[str, Tree]) -> None:
    added = {name: one for name, one in every.items() if "profiles" in one}
    assert sorted(added) == sorted(["agents", *PROFILES, *(f"{name}-port" for name in PROFILES)])
    for name, port in PROFILES.items():
        server, door = added[name], added[f"{name}-port"]
        assert server["profiles"] == door["profiles"] == [name]
        assert server["network_mode"] == f"service:{HOLDS_THE_NETWORK}"
        assert server["depends_on"] == {"supervisor": {"condition": "service_healthy"}}
        assert server["healthcheck"]["test"][:3] == ["CMD", "serves", str(port)]
        assert door["entrypoint"] == ["forward", str(port), HOLDS_THE_NETWORK]
        assert door["ports"] == [f"127.0.0.1:{port}:{port}"]
        assert "network_mode" not in door
    agents = added["agents"]
    assert (agents["profiles"], agents.get("ports")) == (["agents"], None)
    rig = read_rig(Path(__file__).parents[2] / "deploy/rigs/demo.toml")
    assert (rig.sila.port, rig.foxglove.port) == (PROFILES["sila"], PROFILES["foxglove"])


def test_all_data_goes_into_one_volume(compose: Tree, services: dict[str, Tree]) -> None:
    assert compose["volumes"] == {"data": None}
    writing = {name for name, one in services.items() if one.get("command", [])[2:] != []}
    # The actuator stores how it ended, and reads that when it starts.
    assert writing == {"actuator", "recorder", "supervisor"}
    assert all(services[name]["command"][2:] == ["--data", "/data"] for name in writing)
    assert {name for name, one in services.items() if one.get("volumes") == ["data:/data"]} == (
        writing
    )


@pytest.mark.parametrize("name", ["real-time", "real-rig"])
def test_containers_of_periodic_programs_may_use_a_fixed_priority(root: Path, name: str) -> None:
    over = overlay(root, name)
    given = {one for one, service in over.items() if "ulimits" in service}
    assert given == {*OF_THE_LOOP} - ({"rig"} if name == "real-rig" else set())
    assert {over[one]["ulimits"]["rtprio"] for one in given} == {FIFO}


def test_a_real_rig_has_no_simulated_rig_and_one_rig_file(root: Path) -> None:
    over = overlay(root, "real-rig")
    assert over["rig"] == {"profiles": ["simulated"]}
    for name in set(contained()) - {"rig"}:
        assert over[name]["volumes"][0].endswith(":/etc/pincette/rig.toml:ro"), name
    assert {name for name in over if "devices" in over[name]} == {"sensor", "actuator"}


def test_no_program_holds_the_key_of_the_authority(root: Path) -> None:
    over = overlay(root, "secure")
    for name in contained():
        assert over[name]["environment"] == {"PINCETTE_PKI": "/pki/made"}
        assert over[name]["volumes"] == ["pki:/pki:ro"]
        waits = over[name]["depends_on"]["certificates"]
        assert waits == {"condition": "service_completed_successfully"}
    maker = over["certificates"]
    assert maker["volumes"] == ["pki:/pki", "authority:/authority"]
    assert maker["network_mode"] == "none"
    assert "/authority/" in maker["command"][0]


def _ran(command: list[str], folder: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=60.0, check=False
    )


@pytest.mark.parametrize("name", ["", *OVERLAYS])
def test_the_files_are_valid(root: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("RIG_FILE", "SENSOR", "OUTPUT"):
        monkeypatch.setenv(f"PINCETTE_{variable}", "/dev/null")
    over = ["-f", "docker-compose.yml", *(["-f", f"deploy/{name}.yml"] if name else [])]
    if name:
        profiled = {"agents", *PROFILES}
        known = {*contained(), HOLDS_THE_NETWORK, "certificates", *profiled}
        assert set(overlay(root, name)) <= known
    docker = shutil.which("docker")
    if docker is None or _ran([docker, "compose", "version"], root).returncode:
        # An engine may lack this plug-in; the rest of the file is tested without it.
        pytest.skip("docker compose is missing: its files cannot be validated")
    done = _ran([docker, "compose", *over, "config", "--quiet"], root)
    assert done.returncode == 0, done.stderr
