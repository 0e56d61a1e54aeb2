"""Hostile clients of every kind at once: stops, other clients and the loop are not delayed.

Real processes, real time. The hostile clients of ``tests.support.hostile`` run during a grip. A
scheduling stall of the machine is subtracted from the measured times.
"""

import ssl
from collections.abc import Callable, Generator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Thread
from time import monotonic, sleep

import httpx
import numpy as np
import pytest

from pincette.api.states import STATES
from pincette_supervisor.access.key_store import open_keys
from tests.support.certificates import folder_for
from tests.support.grips import SHORT, make_ready
from tests.support.hostile import ATTACKS, attacked
from tests.support.keys import shown
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig
from tests.support.stalls import StallRecorder

pytestmark = [pytest.mark.usefixtures("stalls"), pytest.mark.slow]

ESTOP_S, STOP_S, READ_S = 0.3, 1.0, 2.0
"""Limits: an emergency stop at p99, the stop of a job, and an honest client's list of jobs."""
PAUSE_S = 0.1
ESTABLISHED = "01"
"""State of a connection in /proc/net/tcp."""
PATIENCE_S = 60.0
"""Longest time until all hostile clients are connected."""


@dataclass
class Honest:
    """A client that reads the list of jobs repeatedly until it is closed."""

    rig: RunningRig
    took_s: list[float] = field(default_factory=list[float])
    statuses: set[int] = field(default_factory=set[int])
    _end: Event = field(default_factory=Event)

    def run(self) -> None:
        """Read until the end, over a persistent connection."""
        while not self._end.wait(PAUSE_S):
            begun_s = monotonic()
            self.statuses.add(self.rig.client.get("/jobs").status_code)
            self.took_s.append(monotonic() - begun_s)

    def __enter__(self) -> "Honest":
        self._thread = Thread(target=self.run)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()


@pytest.fixture
def rig(request: pytest.FixtureRequest, tmp_path: Path) -> Generator[RunningRig]:
    secure, keys = request.param
    own = demo_rig(SHORT)
    key = None
    if secure:
        own = own.secured(folder_for(tmp_path / "pki", own.rig.name).path)
    if keys:
        with open_keys(tmp_path / "data") as store:
            key = store.add("bench", "admin", None)[0]
    with running_rig(own, tmp_path, key=key) as running:
        make_ready(running, 30.0)
        yield running


def took_s(what: Callable[[], httpx.Response]) -> float:
    """Return the duration of a request that must succeed."""
    begun_s = monotonic()
    what().raise_for_status()
    return monotonic() - begun_s


def ended_job(rig: RunningRig, name: str, timeout_s: float) -> Json:
    """Return a job once its record is written.

    Without keys the hostile clients and this one share the long polls of one address.
    """
    deadline = monotonic() + timeout_s
    while monotonic() < deadline:
        job = rig.job(name)
        if STATES[job["state"]].terminal and job["artifacts"] != "being_written":
            return job
        sleep(PAUSE_S)
    raise TimeoutError(f"job {name} did not end within {timeout_s:g} s: {rig.job(name)}")


def grip(rig: RunningRig, hold_s: float) -> int:
    """Grip, and return how many ticks were missed or had no echo."""
    ended = ended_job(rig, rig.start_grip(hold_s=hold_s), hold_s + 120.0)
    assert ended["state"] == "succeeded", ended["cause"]
    result: Json = ended["result"]
    return int(result["missed_ticks"] + result["unanswered_ticks"])


@pytest.mark.parametrize(
    ("rig", "clients", "hold_s", "estops"),
    [
        pytest.param((False, True), 4, 3.0, 20, id="keys-4"),
        *(
            pytest.param((secure, keys), 16, 10.0, 100, id=name)
            for secure, keys, name in (
                (False, False, "plain-16"),
                (False, True, "keys-16"),
                (True, True, "tls-keys-16"),
            )
        ),
    ],
    indirect=["rig"],
)
def test_no_client_starves_the_others(
    rig: RunningRig,
    stalls: StallRecorder,
    figures: list[str],
    clients: int,
    hold_s: float,
    estops: int,
) -> None:
    begun_s = monotonic()
    idle_missed = grip(rig, hold_s)
    own_key = rig.client.headers.get("Authorization", "").removeprefix("Bearer ")
    job = rig.get("/jobs")["jobs"][0]["id"]
    path = f"{rig.client.base_url}rigs/{rig.rig.rig.name}/estop"

    tls = ssl.create_default_context()
    tls.check_hostname, tls.verify_mode = False, ssl.CERT_NONE
    # Created before the measurement, since that takes longer than a stop. Each request has a new
    # connection: an idle one may have been closed in favour of others.
    idle = httpx.Limits(max_keepalive_connections=0)
    stranger = httpx.Client(timeout=60.0, trust_env=False, verify=tls, limits=idle)

    def fresh(url: str, body: Json | None = None) -> httpx.Response:
        return stranger.post(url, json=body, headers=shown(own_key) if own_key else {})

    with ExitStack() as stack:
        stack.enter_context(stranger)
        tally = stack.enter_context(
            attacked(str(rig.client.base_url), clients, key=hostile_key(rig, own_key), job=job)
        )
        until_connected(rig, clients * len(ATTACKS))
        with Honest(rig) as honest:
            busy_missed = grip(rig, hold_s)
            name = rig.start_grip(until_released=True)
            rig.until_phase(name, "hold")
            url = f"{rig.client.base_url}jobs/{name}/actions"
            stop_s = took_s(lambda: fresh(url, {"type": "stop"}))
            estops_s = list[float]()
            for _ in range(estops):
                estops_s.append(took_s(lambda: fresh(path)))
                sleep(PAUSE_S)
    p50_s, p99_s = (float(np.percentile(estops_s, share)) for share in (50.0, 99.0))
    read_s = float(np.percentile(honest.took_s, 99.0))
    figures.append(
        f"{clients} hostile clients of each kind: emergency stop p50 {1e3 * p50_s:.0f} ms, p99 "
        f"{1e3 * p99_s:.0f} ms; stop of a job {1e3 * stop_s:.0f} ms; {len(honest.took_s)} lists "
        f"of jobs p99 {1e3 * read_s:.0f} ms; {busy_missed} ticks missed, {idle_missed} when idle; "
        f"{tally}; the machine stood still for {1e3 * stalls.between(begun_s, monotonic()):.0f} ms"
    )
    assert p99_s <= ESTOP_S
    assert stop_s <= STOP_S
    assert read_s <= READ_S
    assert honest.statuses == {200}
    assert busy_missed <= idle_missed


def until_connected(rig: RunningRig, least: int) -> None:
    """Wait until the supervisor has at least so many connections of the hostile clients."""
    local = f":{rig.rig.supervisor.port:04X}"
    deadline = monotonic() + PATIENCE_S
    while True:
        rows = [row.split() for row in Path("/proc/net/tcp").read_text().splitlines()[1:]]
        if sum(row[1].endswith(local) and row[3] == ESTABLISHED for row in rows) >= least:
            return
        assert monotonic() < deadline
        sleep(PAUSE_S)


def hostile_key(rig: RunningRig, own_key: str) -> str:
    """Return a key for the hostile clients, if keys are required."""
    if not own_key:
        return ""
    with open_keys(rig.data) as store:
        return store.add("hostile", "operate", None)[0]
