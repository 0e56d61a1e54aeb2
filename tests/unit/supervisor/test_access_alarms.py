"""The alarms ``keys``, ``key-clock`` and ``clock`` over a real connection: who is refused what.

Time is virtual.
"""

from collections.abc import Iterator
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import pytest

from pincette.api.access import Scope
from pincette.api.problems import MEDIA_TYPE, TYPE
from pincette.core.faults import FaultCode, fault
from pincette_recorder.counted_time import CountedTime
from pincette_supervisor.access.access import Access, KeySync
from pincette_supervisor.access.authentication import UNCONFIRMED_S, Authenticator
from pincette_supervisor.journal.database import KEY_FILE
from tests.support.apps import create_app
from tests.support.keys import ScopeKeys, key_of_each_scope
from tests.support.served import served

from .harness import Harness

HOUR, DAY = timedelta(hours=1), timedelta(days=1)


def code_of(answer: httpx.Response) -> str:
    assert answer.headers["content-type"] == MEDIA_TYPE
    return str(answer.json()["type"]).removeprefix(TYPE)


class Desk:
    """A served supervisor whose clocks a test sets."""

    def __init__(self, harness: Harness, url: str, client: httpx.Client, keys: ScopeKeys) -> None:
        self.harness, self.url, self.client, self.keys = harness, url, client, keys
        self.wall = datetime.now(UTC) + DAY
        self.passed_s = 0.0

    def call(
        self, method: str, path: str, scope: Scope | None = "operate", body: Any = None
    ) -> httpx.Response:
        headers = {} if scope is None else self.keys.headers(scope)
        return self.client.request(method, f"{self.url}/api/v1{path}", headers=headers, json=body)

    def alarms(self, *, only_open: bool = True) -> dict[str, dict[str, Any]]:
        # A supervisor of a rig in lockstep asks its programs only when it is asked itself.
        assert self.call("GET", "/rigs/demo", "observe").status_code == 200
        self.harness.manager.alarm_monitor.poll()
        answer = self.call("GET", f"/alarms?open={'true' if only_open else 'false'}", "observe")
        assert answer.status_code == 200, answer.text
        return {row["cause"]: row for row in answer.json()["alarms"]}

    def acknowledge(self, alarm: dict[str, Any], scope: Scope | None) -> httpx.Response:
        path = f"/alarms/{alarm['id']}/actions"
        return self.call("POST", path, scope, {"type": "acknowledge"})

    def assert_that_a_stop_acts(self) -> None:
        """Stop without a key and with each one, by every path; reset the rig by the harness."""
        for path in ("/estop", "/rigs/demo/estop", "/rigs/demo/estop/"):
            for scope in ALL:
                answer = self.call("POST", path, scope)
                assert answer.status_code == 200, answer.text
                assert self.harness.bus.latch == "estop"
                self.harness.bus.latch = ""


@pytest.fixture
def desk(harness: Harness) -> Iterator[Desk]:
    keys = key_of_each_scope(harness.store)
    with ExitStack() as stack:
        client = stack.enter_context(httpx.Client(trust_env=False, timeout=30.0))
        made = Desk(harness, "", client, keys)
        access = Access(
            Authenticator(wall=lambda: made.wall, clock=lambda: made.passed_s, supervisor="desk")
        )
        sync = KeySync(harness.store, access)
        stack.callback(sync.close)
        made.url = stack.enter_context(served(create_app(harness.rigs, access)))
        yield made


REQUESTS = [
    ("GET", "/jobs"),
    ("GET", "/rigs"),
    ("GET", "/alarms"),
    ("POST", "/jobs"),
    ("POST", "/jobs?dry_run=true"),
    ("POST", "/calibrations"),
    ("POST", "/rigs/demo/reset"),
    ("POST", "/session"),
]


BODIES = {"/session": {"user": "ann", "password": "secret"}}
ALL: tuple[Scope | None, ...] = (None, "observe", "operate", "admin")


def test_if_keys_cannot_be_read_everything_but_a_stop_is_refused(desk: Desk) -> None:
    assert desk.call("GET", "/jobs").status_code == 200
    file = desk.harness.store.folder / KEY_FILE
    away = file.with_suffix(".away")
    file.rename(away)
    file.mkdir()  # which no program, not even one of root, can read as a file
    desk.harness.until(lambda: "keys" in desk.alarms())
    alarm = desk.alarms()["keys"]
    assert alarm["cleared_at"] is None
    assert str(file) in alarm["words"]
    desk.assert_that_a_stop_acts()

    desk.passed_s += UNCONFIRMED_S + 1.0
    for scope in ALL:
        for method, path in REQUESTS:
            answer = desk.call(
                method, path, scope, BODIES.get(path, {}) if method == "POST" else None
            )
            assert (answer.status_code, code_of(answer)) == (503, "keys-unconfirmed"), path
            assert answer.json()["remedy"]
        session = desk.call("GET", "/session", scope).json()
        assert (session["name"], session["scope"]) == (None, None)
        check = desk.call("POST", "/rigs/demo/page-check", scope).json()
        assert (check["stop"]["accepted"], check["order"]["code"]) == (True, "keys-unconfirmed")
    for probe in ("/livez", "/readyz"):
        assert desk.client.get(desk.url + probe).status_code == 200
    desk.assert_that_a_stop_acts()

    file.rmdir()
    away.rename(file)
    desk.harness.until(lambda: desk.call("GET", "/jobs").status_code == 200)
    desk.harness.until(lambda: desk.alarms()["keys"]["cleared_at"] is not None)
    assert desk.acknowledge(desk.alarms()["keys"], "operate").status_code == 200
    assert "keys" not in desk.alarms()
    assert desk.call("GET", "/jobs", None).status_code == 401


def test_a_key_revoked_while_keys_cannot_be_read_stays_refused(desk: Desk) -> None:
    file = desk.harness.store.folder / KEY_FILE
    content = file.read_text(encoding="utf-8")
    file.write_text("{", encoding="utf-8")
    desk.harness.until(lambda: "keys" in desk.alarms())
    desk.passed_s += UNCONFIRMED_S + 1.0
    revoked = content.replace('"revoked_at": null', '"revoked_at": "2026-01-01T00:00:00.000Z"')
    file.write_text(revoked, encoding="utf-8")
    desk.harness.until(lambda: desk.call("GET", "/jobs").status_code != 503)
    for scope in ALL[1:]:
        answer = desk.call("GET", "/jobs", scope)
        assert (answer.status_code, code_of(answer)) == (401, "no-key")
    desk.assert_that_a_stop_acts()


def test_a_clock_that_has_stepped_back_raises_an_alarm_that_only_an_admin_may_acknowledge(
    desk: Desk,
) -> None:
    desk.wall -= 26 * HOUR
    desk.harness.until(lambda: "key-clock" in desk.alarms())
    alarm = desk.alarms()["key-clock"]
    codes = dict(zip(ALL, ("no-key", "scope-too-small", "scope-too-small"), strict=False))
    assert {scope: code_of(desk.acknowledge(alarm, scope)) for scope in codes} == codes
    assert "key-clock" in desk.alarms()
    assert desk.call("GET", "/jobs").status_code == 200  # a key without an expiry is not affected
    desk.assert_that_a_stop_acts()
    assert desk.acknowledge(alarm, "admin").status_code == 200
    desk.harness.until(lambda: "key-clock" not in desk.alarms())


@pytest.mark.parametrize("step", [200 * DAY, -200 * DAY])
def test_a_clock_that_has_stepped_forward_raises_an_alarm_and_nothing_is_deleted(
    desk: Desk, step: timedelta
) -> None:
    records = desk.harness.manager.context.records
    records.mkdir(exist_ok=True)
    now_s = [1e9, 0.0]
    counted = CountedTime(records, lambda: now_s[0], lambda: now_s[1])
    assert counted.ages_s(["job"]) == {"job": 0.0}
    now_s[0] += step.total_seconds()
    counted.count()
    assert counted.step_s == step.total_seconds()
    finding = fault(FaultCode.CLOCK_STEPPED, step_s=step.total_seconds())
    desk.harness.bus.findings["recorder"] = (finding,)
    desk.harness.until(lambda: "clock" in desk.alarms())
    alarm = desk.alarms()["clock"]
    assert f"{step.total_seconds():+.0f} s" in alarm["words"]
    assert counted.ages_s(["job"]) == {"job": 0.0}
    desk.assert_that_a_stop_acts()
    assert desk.call("POST", "/jobs?dry_run=true", body={"kind": "grip"}).status_code == 200

    codes = dict(zip(ALL, ("no-key", "scope-too-small"), strict=False))
    assert {scope: code_of(desk.acknowledge(alarm, scope)) for scope in codes} == codes
    counted.count()
    assert counted.step_s is not None
    assert desk.acknowledge(alarm, "operate").status_code == 200
    counted.count()
    assert counted.step_s is None
    desk.harness.bus.findings["recorder"] = ()
    desk.harness.until(lambda: "clock" not in desk.alarms())
