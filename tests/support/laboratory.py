"""Two rigs on one router under one supervisor, in lockstep."""

import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import Any

from pincette.config import RigFile
from pincette.config.reading import laid_over
from pincette.core.topics import LOOP
from pincette.engine.fleet import Fleet
from tests.support.rigs import demo_rig, rig_toml
from tests.support.running import RunningRig, running_rig

Json = dict[str, Any]
DELAYS = {name: 7 + place for place, name in enumerate(LOOP)}
"""Seeds of delays of up to 3 ms, so that two loops in lockstep leave processor time to others."""
PATIENCE_S = 60.0


@dataclass
class Laboratory:
    """The rig with the router and the supervisor, and a rig that joins it."""

    left: RunningRig
    right: RigFile
    fleet: Fleet | None = None

    def start_right(self, right: RigFile | None = None) -> None:
        self.right = right or self.right
        path = self.left.path.with_name("right.toml")
        path.write_text(rig_toml(self.right), encoding="utf-8")
        self.fleet = Fleet(self.right, path, self.left.data, lambda _name, _line: None)
        self.fleet.start(["rig"])
        delays = {name: ("--delay-ms", "3", "--delay-seed", str(DELAYS[name])) for name in LOOP}
        self.fleet.start_each(delays)
        self.fleet.start(["recorder"])

    def kill_right(self) -> None:
        assert self.fleet is not None
        for name in self.fleet.members:
            self.fleet.signal(name, signal.SIGKILL)
        self.fleet.down()

    def rigs(self) -> dict[str, Json]:
        return {rig["name"]: rig for rig in self.left.get("/rigs")["rigs"]}

    def grip(self, rig: str, **wishes: object) -> str:
        return self.left.start_grip(rig=rig, **wishes)

    def reset(self, rig: str) -> None:
        self.left.post(f"/rigs/{rig}/reset", {"acknowledge": True}).raise_for_status()

    def until(self, there: Callable[[], object]) -> None:
        deadline = monotonic() + PATIENCE_S
        while not there():
            assert monotonic() < deadline, self.rigs()
            sleep(0.05)

    def let_go(self, rig: str) -> None:
        """Release the part as soon as allowed, unless the rig has done so 10 s after a trip."""
        self.until(lambda: self.rigs()[rig]["startable"])
        if self.rigs()[rig]["part"] != "held":
            return
        body = {"kind": "release", "rig": rig, "autostart": True}
        job = self.left.post("/jobs", body).raise_for_status().json()["id"]
        assert self.left.ended(job)["state"] == "succeeded"

    def gripped(self, job: str) -> None:
        """Wait for the end of a grip, and check that it succeeded."""
        ended = self.left.ended(job)
        assert (ended["state"], ended["cause"]) == ("succeeded", "")
        assert ended["result"]["outcome"] == "gripped"


@contextmanager
def laboratory(
    folder: Path, changes: Json | None = None, key: str | None = None
) -> Generator[Laboratory]:
    """Start both rigs, with the same changes; ``key``: key of a supervisor that requires one."""
    own = {"rig": {"name": "left"}}
    left = demo_rig(laid_over(own, changes or {}), time="lockstep")
    joins = {
        "rig": {"name": "right"},
        "bus": {"router": f"127.0.0.1:{left.bus.port}"},
        "supervisor": {"port": left.supervisor.port},
    }
    with running_rig(left, folder, DELAYS, key) as running:
        made = Laboratory(running, demo_rig(laid_over(joins, changes or {}), time="lockstep"))
        try:
            made.start_right()
            made.until(lambda: made.rigs().get("right", {}).get("can_start"))
            for rig in ("left", "right"):
                made.reset(rig)
            yield made
        finally:
            if made.fleet is not None:
                made.fleet.down()
