"""A rig on one host and its supervisor on another: ``python -m tests.support.two_hosts FOLDER``.

The hosts are two networks with one cable between them, which can be pulled. Their clocks have
nothing to do with each other: the monotonic clock of the edge computer is months ahead, and what
its programs take for the time of day is days ahead. To be run within a network of its own: see
``namespaces.alone``. What came of it is one JSON object on standard output.
"""

import argparse
import json
import os
import subprocess
import sys
import threading
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import httpx

from pincette.config import RigFile
from pincette.config.reading import laid_over
from pincette.security.establishing import enrol_upstream, establish
from pincette.security.folder import Folder
from tests.support.grips import SHORT
from tests.support.namespaces import INSIDE
from tests.support.rigs import demo_rig, rig_toml

ROOT = Path(__file__).parents[2]
SERVER, EDGE = "10.89.0.1", "10.89.0.2"
CABLE, FAR_END = "pcablea", "pcableb"
AHEAD_S, WALL_AHEAD_S = 5_000_000, 3 * 86_400.0
LEASE_S, CUT_S = 1.5, 4.0
START_S, END_S = 120.0, 30.0
Json = dict[str, Any]
ENDS = ("succeeded", "stopped", "aborted", "failed", "interrupted")


def far_rig() -> RigFile:
    """The demo rig on the edge computer, served from the laboratory server."""
    upstream_port = 7447
    changes: Json = {
        "bus": {"host": EDGE, "upstream": f"{SERVER}:{upstream_port}"},
        "safety": {"lease_s": LEASE_S},
    }
    return demo_rig(laid_over(SHORT, changes))


def certificates(folder: Path, rig: str) -> Path:
    """A folder of certificates for both hosts."""
    pki, now = Folder(folder / "pki"), datetime.now(UTC)
    establish(pki, [rig], [EDGE], now)
    enrol_upstream(pki, [SERVER], now)
    return pki.path


class Hosts:
    """Both hosts, once they are up."""

    def __init__(self, rig: RigFile, path: Path, folder: Path, env: dict[str, str]) -> None:
        self._rig, self._path, self._folder, self._env = rig, path, folder, env
        self._edge: subprocess.Popen[str] | None = None
        self._begun: list[subprocess.Popen[str]] = []
        self.seen: list[Json] = []
        """What the witness on the edge computer has heard."""
        url = f"http://{rig.supervisor.host}:{rig.supervisor.port}"
        self.client = httpx.Client(base_url=url, timeout=30.0, trust_env=False)

    def _begin(self, words: Sequence[str], name: str, **env: str) -> subprocess.Popen[str]:
        with (self._folder / f"{name}.log").open("w", encoding="utf-8") as log:
            process = subprocess.Popen(
                words,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE if name == "witness" else log,
                stderr=log,
                text=True,
                env={**self._env, **env},
                cwd=ROOT,
            )
        self._begun.append(process)
        return process

    def _up(self, *words: str, data: str) -> list[str]:
        place = ["--rig", str(self._path), "--data", str(self._folder / data)]
        return [sys.executable, "-m", "pincette", "up", *place, *words]

    def begin_edge(self) -> None:
        """The loop and its router, in a network and a time of their own."""
        (self._folder / "ahead").write_text(str(WALL_AHEAD_S), encoding="utf-8")
        ready = f"until ip link show {FAR_END} >/dev/null 2>&1; do sleep 0.02; done"
        up = f"ip addr add {EDGE}/24 dev {FAR_END}; ip link set {FAR_END} up; ip link set lo up"
        offset = ["--monotonic", str(AHEAD_S), "--boottime", str(AHEAD_S)]
        own = ["unshare", "--net", "--time", *offset, "--fork", "--kill-child=SIGTERM", "--"]
        self._edge = self._begin(
            [*own, "sh", "-c", f'{ready}; {up}; exec "$@"', "sh", *self._up(data="edge")],
            "edge",
            PYTHONPATH=str(ROOT / "tests/support/set_clock"),
            PINCETTE_TEST_CLOCK=str(self._folder / "ahead"),
        )
        ip("link", "add", CABLE, "type", "veth", "peer", "name", FAR_END)
        ip("addr", "add", f"{SERVER}/24", "dev", CABLE)
        ip("link", "set", CABLE, "up")
        here = Path("/proc/self/ns/net").readlink()
        there = Path(f"/proc/{self._edge.pid}/ns/net")
        wait(lambda: there.readlink() != here, "a network of the edge computer's own")
        ip("link", "set", FAR_END, "netns", str(self._edge.pid))

    def begin_server(self) -> None:
        """Router, recorder and supervisor."""
        self._begin(self._up("--server", data="server"), "server")
        wait(lambda: self.answers("/readyz"), "the supervisor")

    def begin_witness(self) -> None:
        """Somebody who listens at the rig's router, whatever becomes of the cable."""
        if self._edge is None:
            raise RuntimeError("there is no edge computer yet")
        where = ["nsenter", "--target", str(self._edge.pid), "--net", "--"]
        words = [sys.executable, "-m", "tests.support.edge_witness", str(self._path)]
        process = self._begin([*where, *words], "witness")
        threading.Thread(target=self._listen, args=(process,), daemon=True).start()
        wait(lambda: bool(self.seen), "the witness")

    def _listen(self, process: "subprocess.Popen[str]") -> None:
        for line in process.stdout or ():
            self.seen.append(json.loads(line))

    def answers(self, path: str) -> bool:
        """Whether REST says yes."""
        try:
            return self.client.get(path).status_code == 200
        except httpx.HTTPError:
            return False

    def get(self, path: str, **query: object) -> Json:
        """Read a resource."""
        answer = self.client.get(f"/api/v1{path}", params=query)  # pyright: ignore[reportArgumentType]
        return answer.raise_for_status().json()

    def post(self, path: str, body: Json) -> Json:
        """Ask for something; what is refused says so."""
        return self.client.post(f"/api/v1{path}", json=body).json()

    def grip(self, **wishes: object) -> str:
        """Begin a grip; the job's id."""
        taken = self.post("/jobs", {"kind": "grip", "autostart": True, **wishes})
        if "id" not in taken:
            raise RuntimeError(f"refused: {taken}")
        return str(taken["id"])

    def ended(self, job: str) -> Json:
        """A job once it has ended."""
        wait(lambda: self.get(f"/jobs/{job}")["state"] in ENDS, f"the end of {job}", END_S)
        return self.get(f"/jobs/{job}")

    def until_phase(self, job: str, phase: str) -> None:
        """Wait until a job is in a phase."""

        def there() -> bool:
            progress: Json = self.get(f"/jobs/{job}").get("progress") or {}
            return progress.get("phase") == phase

        wait(there, f"{job} in {phase}", END_S)

    def end(self) -> None:
        """End everything that was begun here, the newest first."""
        self.client.close()
        for process in reversed(self._begun):
            if process.stdin is not None:
                process.stdin.close()
            process.terminate()
        for process in reversed(self._begun):
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def ip(*words: str) -> None:
    """Set up this network."""
    subprocess.run(["ip", *words], check=True, timeout=10.0)


def wait(done: Any, what: str, within_s: float = START_S) -> float:
    """Until something is the case; the time of it."""
    deadline = monotonic() + within_s
    while not done():
        if monotonic() > deadline:
            raise TimeoutError(f"{what}: not within {within_s:g} s")
        sleep(0.02)
    return monotonic()


@contextmanager
def hosts(folder: Path, *, secure: bool) -> Generator[Hosts]:
    """Both hosts up, connected, with the rig ready."""
    if INSIDE not in os.environ:
        raise RuntimeError("two hosts are made in a network of their own only")
    rig, path = far_rig(), folder / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    env = {**os.environ}
    if secure:
        env["PINCETTE_PKI"] = str(certificates(folder, rig.rig.name))
    both = Hosts(rig, path, folder, env)
    try:
        both.begin_edge()
        both.begin_server()
        both.begin_witness()
        yield both
    finally:
        both.end()


def brief(job: Json) -> Json:
    """What of a job is told."""
    names = ("state", "cause", "record_complete", "record_detail")
    return {name: job.get(name) for name in names}


def experiment(both: Hosts, grips: int) -> Json:
    """Grips; one whose cable is pulled while it holds; what follows; another one."""
    told: Json = {"grips": [brief(both.ended(both.grip())) for _ in range(grips)]}
    job = both.grip(until_released=True)
    both.until_phase(job, "hold")
    cut_s = monotonic()
    ip("link", "set", CABLE, "down")
    sleep(CUT_S)
    told["while_cut"] = [one for one in both.seen if one["at_s"] > cut_s]
    told["in_the_cut"] = brief(both.get(f"/jobs/{job}"))
    healed_s = monotonic()
    ip("link", "set", CABLE, "up")
    told["ready_after_s"] = wait(lambda: both.answers("/readyz"), "whole again") - healed_s
    told["held_job"] = brief(both.ended(job))
    told["rig"] = both.get("/rigs/demo")
    return told | {"cut_s": cut_s}


def main() -> None:
    """Try it, and say what came of it."""
    known = argparse.ArgumentParser()
    known.add_argument("folder", type=Path)
    known.add_argument("--secure", action="store_true")
    known.add_argument("--grips", type=int, default=1)
    given = known.parse_args()
    with hosts(given.folder, secure=given.secure) as both:
        told = experiment(both, given.grips)
    json.dump(told, sys.stdout)


if __name__ == "__main__":
    main()
