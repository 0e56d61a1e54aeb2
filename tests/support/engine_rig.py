"""A rig in containers, with the interface of a rig in processes."""

import json
import os
import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import cast

import httpx
import pytest

from pincette.config import RigFile, parse_rig, read_rig
from pincette.config.reading import laid_over
from pincette.engine.fleet import Child, Fleet
from tests.support.contained import contained
from tests.support.engine import Project, told, up
from tests.support.grips import SHORT
from tests.support.rigs import DEMO, Tree, rig_toml
from tests.support.running import RunningRig

HEALTHY_S = 90.0
SEEN_FROM_OUTSIDE: Tree = {"supervisor": {"host": "0.0.0.0", "behind": "container"}}


class Containers(Fleet):
    """Programs as containers, which Docker restarts."""

    def __init__(self, project: Project) -> None:
        self.members = {}
        self.project = project

    def ended(self) -> list[Child]:
        """Return None: the tests do not restart these programs."""
        return []

    def process(self, name: str) -> int:
        """Return the id of a program's process on this machine: a child of the init of its
        container."""
        init = int(self._inspected(name, "{{.State.Pid}}"))
        children = Path(f"/proc/{init}/task/{init}/children").read_text(encoding="utf-8").split()
        assert len(children) == 1, f"{name}: {init} has {children}"
        return int(children[0])

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to one program."""
        os.kill(self.process(name), number)

    def restarts(self, name: str) -> int:
        """Return how often Docker has restarted a program."""
        return int(self._inspected(name, "{{.RestartCount}}"))

    def health(self, name: str) -> str:
        """Return the last output of the health check, while the container runs."""
        running, health = self._inspected(
            name, "{{.State.Running}} {{.State.Health.Status}}"
        ).split()
        return health if running == "true" else "gone"

    def until_restarted(self, name: str, before: int, timeout_s: float = HEALTHY_S) -> None:
        """Wait until Docker has restarted a program and it is healthy."""
        self._until(lambda: self.restarts(name) > before, f"{name} was not restarted", timeout_s)
        self.until_healthy(timeout_s)

    def until_healthy(self, timeout_s: float = HEALTHY_S) -> None:
        """Wait until every program is healthy."""

        def all_are() -> bool:
            return all(self.health(name) == "healthy" for name in contained())

        self._until(all_are, "not all are healthy", timeout_s)

    def _until(self, holds: Callable[[], bool], what: str, timeout_s: float) -> None:
        deadline = monotonic() + timeout_s
        while not holds():
            if monotonic() > deadline:
                found = {name: self.health(name) for name in contained()}
                raise TimeoutError(f"{what} after {timeout_s:g} s: {found}\n{self.project.said()}")
            sleep(0.2)

    def _inspected(self, name: str, wanted: str) -> str:
        return told("inspect", "--format", wanted, self.project.container(name))


@dataclass(frozen=True)
class ContainerRig(RunningRig):
    """A running rig in containers; its router can be reached from here."""

    containers: Containers


def short_rig() -> RigFile:
    """Return the demo rig with short grips, on the ports of its file."""
    tree = read_rig(DEMO).model_dump(mode="json", exclude_none=True)
    return parse_rig(laid_over(laid_over(tree, SHORT), SEEN_FROM_OUTSIDE))


def adapted_rig() -> RigFile:
    """Return the demo rig in lockstep, so that stalls of the machine cause no trip, with
    adapters."""
    tree = read_rig(DEMO).model_dump(mode="json", exclude_none=True)
    own: Tree = {"rig": {"time": "lockstep"}, "simulation": {"pace": 1.0}, **SEEN_FROM_OUTSIDE}
    adapters = dict.fromkeys(("sila", "foxglove"), SEEN_FROM_OUTSIDE["supervisor"])
    return parse_rig(laid_over(tree, own | adapters))


def mounting(rig: RigFile, folder: Path, *more: str) -> Path:
    """Write a compose file that mounts a rig file in every program; ``more``: programs of
    profiles."""
    path = folder / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    path.chmod(0o644)
    mounted = {"volumes": [f"{path}:/etc/pincette/rig.toml:ro"]}
    over = folder / "mounting.yml"
    # Every JSON document is one of YAML.
    over.write_text(
        json.dumps({"services": dict.fromkeys([*contained(), *more], mounted)}), encoding="utf-8"
    )
    return over


@contextmanager
def container_rig(name: str, folder: Path, *over: str) -> Generator[ContainerRig]:
    """Start the short rig in containers, with the router's port published, and stop it
    afterwards."""
    rig = short_rig()
    with (
        up(Project(name, "listen", *over, mounting(rig, folder))) as project,
        reached(project, rig, folder) as running,
    ):
        yield running


@contextmanager
def reached(project: Project, rig: RigFile, folder: Path) -> Generator[ContainerRig]:
    """Return the REST client of a running project."""
    url = f"http://127.0.0.1:{rig.supervisor.port}/api/v1"
    containers = Containers(project)
    with httpx.Client(base_url=url, timeout=30.0, trust_env=False) as client:
        yield ContainerRig(rig, folder / "rig.toml", folder, containers, client, containers)


def until_seen_again(rig: RunningRig, timeout_s: float = 30.0) -> float:
    """Return the seconds until the supervisor receives messages of every program of the loop
    again."""
    begun = monotonic()
    reported: list[str] = []
    while monotonic() < begun + timeout_s:
        view = rig.view()
        reported = [program["trouble"] for program in view["programs"] if program["trouble"]]
        if not reported:
            return monotonic() - begun
        sleep(0.1)
    raise TimeoutError(f"programs have not reconnected within {timeout_s:g} s: {reported}")


def only_root() -> None:
    """Skip the test if this user may not signal the processes of containers."""
    if os.geteuid() != 0:
        pytest.skip("only root may send signals to processes of containers or cut their network")


def inspected(image: str) -> Tree:
    """Return the engine's description of an image."""
    return cast(Tree, json.loads(told("image", "inspect", image))[0])
