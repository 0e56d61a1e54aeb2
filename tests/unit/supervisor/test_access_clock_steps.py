"""Keys with an expiry and idle sessions, while the time of day steps back and forward."""

from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from pincette_supervisor.access.access import KEY_CLOCK, Access, KeySync
from pincette_supervisor.access.authentication import (
    IDLE_H,
    Authenticator,
    digest_of,
    new_cookie,
    new_key,
)
from pincette_supervisor.access.key_store import open_keys
from pincette_supervisor.journal.access import KeyFile
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import utc_text
from tests.support.apps import create_app
from tests.support.keys import key_of_each_scope, shown

from .harness import Harness

HERE = "127.0.0.1"
YEAR = timedelta(days=365)
LASTS = timedelta(days=30)
MINUTE = timedelta(minutes=1)


class Clocks:
    """A time of day that a test sets, and the elapsed time."""

    def __init__(self) -> None:
        # Later than the time at which a test runs, so that nothing that it makes is newer.
        self.wall, self.passed_s = datetime.now(UTC) + timedelta(days=1), 0.0

    def authenticator(self) -> Authenticator:
        """Return an authenticator, as after a start of the supervisor."""
        return Authenticator(wall=lambda: self.wall, clock=lambda: self.passed_s)

    def go_on(self, duration: timedelta) -> None:
        self.wall += duration
        self.passed_s += duration.total_seconds()


class Office:
    """A supervisor's authenticator, a key with an end and one without, and a session."""

    def __init__(self, store: Store) -> None:
        self.clocks, self.store = Clocks(), store
        keys = KeyFile(store.folder)
        self.authenticator = self.clocks.authenticator()
        self.ending, self.endless, self.cookie = new_key(), new_key(), new_cookie()
        end = utc_text(self.clocks.wall + LASTS)
        keys.add("ann", digest_of(self.ending), "operate", end)
        keys.add("bob", digest_of(self.endless), "operate")
        self.authenticator.refresh(self.store)
        caller = self.authenticator.identify(HERE, self.endless, None)
        self.authenticator.sign_in(self.store, caller, self.cookie)

    def restart(self) -> None:
        self.authenticator = self.clocks.authenticator()
        self.authenticator.refresh(self.store)

    def step(self, duration: timedelta) -> None:
        """Set the clock; no time passes."""
        self.clocks.wall += duration
        self.authenticator.refresh(self.store)

    def go_on(self, duration: timedelta) -> None:
        self.clocks.go_on(duration)
        self.authenticator.refresh(self.store)

    def opens(self, key: str) -> bool:
        return self.authenticator.identify(HERE, key, None).scope is not None

    def is_signed_in(self) -> bool:
        return self.authenticator.identify(HERE, None, self.cookie).scope is not None


@pytest.fixture
def office(store: Store) -> Office:
    return Office(store)


@pytest.mark.parametrize("restarted", [False, True])
@pytest.mark.parametrize("back", [2 * MINUTE, YEAR])
def test_a_step_back_revives_no_expired_key(
    office: Office, back: timedelta, *, restarted: bool
) -> None:
    office.go_on(LASTS - MINUTE)
    assert office.opens(office.ending)
    office.go_on(MINUTE)
    assert not office.opens(office.ending)
    office.step(-back)
    if restarted:
        office.restart()
    assert not office.opens(office.ending)
    assert office.opens(office.endless)


def test_a_key_expires_by_elapsed_time_while_the_clock_is_behind(office: Office) -> None:
    office.step(-YEAR)
    office.go_on(LASTS - MINUTE)
    assert office.opens(office.ending)
    office.go_on(MINUTE)
    assert not office.opens(office.ending)


def test_a_restart_an_hour_after_a_step_back_does_not_prolong_a_key(office: Office) -> None:
    office.go_on(LASTS - 2 * MINUTE)
    office.step(-YEAR)
    office.restart()
    office.go_on(2 * MINUTE + timedelta(hours=1))  # the time is stored once an hour
    assert not office.opens(office.ending)


@pytest.mark.parametrize("restarted", [False, True])
def test_a_clock_step_back_revives_no_idle_session(office: Office, *, restarted: bool) -> None:
    assert office.is_signed_in()
    office.go_on(timedelta(hours=IDLE_H) + MINUTE)
    assert not office.is_signed_in()
    office.step(-YEAR)
    if restarted:
        office.restart()
    assert not office.is_signed_in()


def test_a_session_idles_by_elapsed_time_while_the_clock_steps(office: Office) -> None:
    for step in (YEAR, -2 * YEAR, YEAR):
        office.step(step)
        assert office.is_signed_in()
    office.step(-YEAR)
    office.go_on(timedelta(hours=IDLE_H) - MINUTE)
    assert office.is_signed_in()
    office.step(-YEAR)
    office.go_on(timedelta(hours=IDLE_H) + MINUTE)
    assert not office.is_signed_in()


def test_a_false_clock_step_forward_suspends_keys_until_a_person_confirms_the_clock(
    office: Office,
) -> None:
    office.step(YEAR)
    assert not office.opens(office.ending)
    office.step(-YEAR)
    office.restart()
    assert not office.opens(office.ending)
    assert office.opens(office.endless)
    office.authenticator.agree_to_time(office.store)
    assert office.opens(office.ending)
    office.restart()
    assert office.opens(office.ending)


def test_a_clock_that_is_behind_raises_an_alarm_that_an_admin_acknowledges(
    harness: Harness,
) -> None:
    clocks = Clocks()
    access = Access(clocks.authenticator())
    harness.app = create_app(harness.rigs, access)
    keys = key_of_each_scope(harness.store)
    with closing(KeySync(harness.store, access)):
        clocks.wall -= timedelta(days=2)

        def rows() -> list[dict[str, object]]:
            harness.manager.alarm_monitor.poll()
            answer = harness.call(
                "GET", "/api/v1/alarms?open=true", headers=keys.headers("observe")
            )
            found = answer.json()
            return [row for row in found["alarms"] if row["cause"] == KEY_CLOCK]

        harness.until(lambda: bool(rows()))
        (row,) = rows()
        place, body = f"/api/v1/alarms/{row['id']}/actions", {"type": "acknowledge"}
        refused = harness.call("POST", place, json=body, headers=keys.headers("operate"))
        assert (refused.status_code, refused.json()["needed_scope"]) == (403, "admin")
        assert access.authenticator.time.ahead > timedelta(days=1)
        agreed = harness.call("POST", place, json=body, headers=keys.headers("admin"))
        assert agreed.status_code == 200
        assert access.authenticator.time.ahead < MINUTE
        harness.until(lambda: not rows())


def test_the_command_line_judges_keys_by_the_latest_time_too(tmp_path: Path) -> None:
    with open_keys(tmp_path) as keys:
        keys.add("ann", "operate", 30.0)
        keys.add("bob", "operate", None)
        KeyFile(tmp_path).note_latest(datetime.now(UTC) + YEAR)
        assert {row.name: row.usable for row in keys.all()} == {"ann": False, "bob": True}
        with pytest.raises(ValueError, match=KEY_CLOCK):
            keys.add("cyd", "operate", 30.0)
        keys.add("cyd", "operate", None)
    assert KeyFile(tmp_path).latest_at() is not None


def test_a_later_change_of_keys_keeps_the_latest_time(tmp_path: Path) -> None:
    latest = datetime(2200, 1, 1, tzinfo=UTC)
    with open_keys(tmp_path) as keys:
        keys.add("ann", "operate", None)
        KeyFile(tmp_path).note_latest(latest)
        assert keys.revoke("ann")
    assert KeyFile(tmp_path).latest_at() == latest


def test_expired_keys_are_refused_over_rest(harness: Harness) -> None:
    clocks, key = Clocks(), new_key()
    access = Access(clocks.authenticator())
    harness.app = create_app(harness.rigs, access)
    store = harness.store
    KeyFile(store.folder).add("ann", digest_of(key), "operate", utc_text(clocks.wall + LASTS))
    access.authenticator.refresh(store)
    assert harness.call("GET", "/api/v1/jobs", headers=shown(key)).status_code == 200
    clocks.go_on(LASTS)
    access.authenticator.refresh(store)
    clocks.wall -= YEAR
    assert harness.call("GET", "/api/v1/jobs", headers=shown(key)).status_code == 401
