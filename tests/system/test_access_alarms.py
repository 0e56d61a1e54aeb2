"""A whole rig whose keys become unreadable, or whose clock steps, while a part is held.

Alarms name it over REST, requests are refused with their codes, and the emergency stop acts.
"""

import os
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import httpx
import pytest

from pincette.api.problems import TYPE
from pincette_supervisor.access.key_store import open_keys
from pincette_supervisor.journal.database import KEY_FILE
from tests.support.grips import SHORT
from tests.support.rigs import paced_rig
from tests.support.running import RunningRig, running_rig

SET_CLOCK = Path(__file__).parents[1] / "support" / "set_clock"
DAY_S = 86_400.0
PATIENCE_S = 60.0


@dataclass(frozen=True)
class Office:
    """A rig whose supervisor wants keys, and whose clock a test sets."""

    running: RunningRig
    clock: Path

    def set_clock(self, shift_s: float) -> None:
        part = self.clock.with_suffix(".part")
        part.write_text(repr(shift_s), encoding="utf-8")
        part.replace(self.clock)

    def alarm(self, cause: str, *, standing: bool = True) -> dict[str, Any]:
        """Wait until the alarm stands, or until its cause is over."""

        def found() -> list[dict[str, Any]]:
            self.running.view()  # in lockstep the supervisor asks its programs when it is asked
            rows = self.running.get("/alarms", open="true", cause=cause)["alarms"]
            return [row for row in rows if (row["cleared_at"] is None) == standing]

        until(lambda: bool(found()))
        return found()[0]

    def is_closed(self, cause: str) -> bool:
        self.running.view()
        return not self.running.get("/alarms", open="true", cause=cause)["alarms"]

    def acknowledge(self, cause: str) -> httpx.Response:
        path = f"/alarms/{self.alarm(cause)['id']}/actions"
        return self.running.post(path, {"type": "acknowledge"})

    def assert_that_a_stop_acts(self) -> None:
        """Stop a grip without a key."""
        with httpx.Client(base_url=self.running.client.base_url, trust_env=False) as stranger:
            answer = stranger.post("/rigs/demo/estop")
        assert answer.status_code == 200, answer.text


def until(holds: Callable[[], bool]) -> None:
    deadline = monotonic() + PATIENCE_S
    while not holds():
        assert monotonic() < deadline
        sleep(0.1)


@pytest.fixture(scope="module")
def office(tmp_path_factory: pytest.TempPathFactory) -> Generator[Office]:
    folder = tmp_path_factory.mktemp("office")
    with open_keys(folder / "data") as keys:
        key = keys.add("ann", "operate", None)[0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PINCETTE_TEST_CLOCK", str(folder / "shift"))
        paths = [str(SET_CLOCK), os.environ.get("PYTHONPATH", "")]
        patch.setenv("PYTHONPATH", os.pathsep.join(paths))
        with running_rig(paced_rig(SHORT), folder, key=key) as running:
            yield Office(running, folder / "shift")


def test_a_step_of_the_clock_deletes_nothing_and_is_an_alarm(office: Office) -> None:
    rig = office.running
    job = rig.start_grip()
    assert rig.ended(job)["record_complete"]
    office.set_clock(200 * DAY_S)
    assert office.alarm("clock")["cleared_at"] is None
    held = rig.start_grip(until_released=True)
    office.assert_that_a_stop_acts()
    assert "estop" in rig.ended(held)["cause"]
    assert rig.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
    assert rig.client.get(f"/jobs/{job}/artifacts/samples.parquet").status_code == 200
    assert office.acknowledge("clock").status_code == 200
    until(lambda: office.is_closed("clock"))

    office.set_clock(0.0)  # a step back
    office.alarm("clock")
    assert office.acknowledge("clock").status_code == 200
    until(lambda: office.is_closed("clock"))
    assert rig.client.get(f"/jobs/{job}/artifacts/samples.parquet").status_code == 200


def test_keys_that_cannot_be_read_shut_all_but_the_stop(office: Office) -> None:
    rig = office.running
    held = rig.start_grip(until_released=True)
    file = rig.data / KEY_FILE
    away = file.with_suffix(".away")
    file.rename(away)
    file.mkdir()
    assert str(file) in office.alarm("keys")["words"]
    until(lambda: rig.client.get("/jobs").status_code == 503)
    for method, path in (
        ("GET", "/jobs"),
        ("GET", "/alarms"),
        ("POST", "/jobs"),
        ("POST", f"/jobs/{held}/actions"),
        ("POST", "/rigs/demo/reset"),
    ):
        answer = rig.client.request(method, path, json={} if method == "POST" else None)
        assert (answer.status_code, code_of(answer)) == (503, "keys-unconfirmed")
    office.assert_that_a_stop_acts()
    assert rig.client.get("/rigs/demo").status_code == 503
    file.rmdir()
    away.rename(file)
    until(lambda: rig.client.get("/jobs").status_code == 200)
    assert "estop" in rig.ended(held)["cause"]
    office.alarm("keys", standing=False)
    assert rig.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200


def code_of(answer: httpx.Response) -> str:
    return str(answer.json()["type"]).removeprefix(TYPE)
