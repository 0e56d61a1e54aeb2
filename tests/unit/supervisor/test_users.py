"""Users who sign in by name and password, in addition to keys."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from time import monotonic

import httpx
import pytest

from pincette.cli import Exit
from pincette.cli.main import main
from pincette_supervisor.access import passwords
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.access.key_store import KeyStore
from pincette_supervisor.access.passwords import (
    FREE_TRIES,
    LONGEST_WAIT_S,
    WAITING_MAX,
    PasswordCheck,
    Tries,
    fits,
    hashed,
)
from pincette_supervisor.journal.access import KeyFile
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import COOKIE
from tests.support.apps import create_app

from .harness import Harness

PASSWORD = "of ten and more"


@pytest.fixture
def bench(harness: Harness, monkeypatch: pytest.MonkeyPatch) -> Harness:
    """A supervisor that Ann may operate, whose hashes cost little."""
    monkeypatch.setattr(passwords, "COST", 2)
    KeyStore(KeyFile(harness.store.folder), harness.store).add_user("ann", "operate", PASSWORD)
    authenticator = Authenticator()
    authenticator.refresh(harness.store)
    harness.app = create_app(harness.rigs, Access(authenticator))
    return harness


def sign_in(bench: Harness, user: str, password: str) -> httpx.Response:
    return bench.post("/session", {"user": user, "password": password})


def test_actions_are_stored_with_the_name_of_the_person(bench: Harness) -> None:
    assert bench.post("/jobs", {"kind": "grip"}).status_code == 401
    signed = sign_in(bench, "ann", PASSWORD)
    assert signed.status_code == 200, signed.text
    assert (signed.json()["name"], signed.json()["scope"]) == ("ann", "operate")
    headers = {"Cookie": f"{COOKIE}={signed.cookies[COOKIE]}"}
    made = bench.call("POST", "/api/v1/jobs", json={"kind": "grip"}, headers=headers)
    assert made.status_code == 201, made.text
    assert made.json()["by"] == "ann"
    refused = bench.call("GET", "/api/v1/audit", headers=headers)
    assert refused.status_code == 403


def test_a_wrong_password_gives_no_access(bench: Harness) -> None:
    for user in ("ann", "nobody"):
        assert sign_in(bench, user, "another password").status_code == 401


def check(clock: Callable[[], float], monkeypatch: pytest.MonkeyPatch) -> PasswordCheck:
    """Return a check of passwords whose hashes cost nothing, on a clock that a test sets."""

    def equal(password: str, kept: str) -> bool:
        return password == kept

    monkeypatch.setattr(passwords, "fits", equal)
    return PasswordCheck(clock)


def test_five_wrong_passwords_delay_a_user_without_locking_the_account(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s, slept_s = 0.0, list[float]()

    async def sleep(delay_s: float) -> None:
        nonlocal now_s
        slept_s.append(delay_s)
        now_s += delay_s

    async def run() -> None:
        one = check(lambda: now_s, monkeypatch)
        for _ in range(FREE_TRIES):
            assert not await one.is_right("ann", "192.0.2.1", "wrong", PASSWORD)
        assert max(slept_s) == 0.0
        # From elsewhere at once, from the same address after a second that the try waits out.
        assert await one.is_right("ann", "192.0.2.2", PASSWORD, PASSWORD)
        assert max(slept_s) == 0.0
        assert await one.is_right("ann", "192.0.2.1", PASSWORD, PASSWORD)
        assert max(slept_s) == 1.0
        for _ in range(FREE_TRIES + 3):
            assert not await one.is_right("ann", "192.0.2.1", "wrong", PASSWORD)
        with pytest.raises(ProblemError) as refusal:
            await one.is_right("ann", "192.0.2.1", PASSWORD, PASSWORD)
        assert refusal.value.status == 429
        assert (refusal.value.headers or {})["Retry-After"] == "8"
        assert await one.is_right("ann", "192.0.2.1", PASSWORD, PASSWORD, trusted=True)

    monkeypatch.setattr(passwords.asyncio, "sleep", sleep)
    asyncio.run(run())


def test_many_sign_in_attempts_from_one_address_delay_another_address_by_one_attempt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    order: list[str] = []

    def fits_noted(password: str, _kept: str) -> bool:
        order.append(password)
        return False

    async def run() -> None:
        one = check(monotonic, monkeypatch)
        monkeypatch.setattr(passwords, "fits", fits_noted)
        flood = [
            asyncio.ensure_future(one.is_right(f"user{n}", "192.0.2.1", "flood", None))
            for n in range(2 * WAITING_MAX)
        ]
        await asyncio.sleep(0.0)
        await one.is_right("ann", "192.0.2.2", "honest", None)
        assert order.index("honest") <= 2
        ended = await asyncio.gather(*flood, return_exceptions=True)
        refused = [one for one in ended if isinstance(one, ProblemError)]
        assert len(refused) == WAITING_MAX
        assert {one.status for one in refused} == {429}

    asyncio.run(run())


def test_concurrent_attempts_do_not_bypass_the_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    async def run() -> None:
        one = check(lambda: 0.0, monkeypatch)
        tries = [one.is_right("ann", "192.0.2.1", "wrong", PASSWORD) for _ in range(WAITING_MAX)]
        ended = await asyncio.gather(*tries, return_exceptions=True)
        checked = [one for one in ended if one is False]
        assert len(checked) == FREE_TRIES + 3  # after waits of 1, 2 and 4 s

    async def sleep(_delay_s: float) -> None:
        return

    monkeypatch.setattr(passwords.asyncio, "sleep", sleep)
    asyncio.run(run())


def test_a_changed_password_ends_the_sessions(bench: Harness) -> None:
    signed = sign_in(bench, "ann", PASSWORD)
    headers = {"Cookie": f"{COOKIE}={signed.cookies[COOKIE]}"}
    keys = KeyStore(KeyFile(bench.store.folder), bench.store)
    assert keys.set_password("ann", "quite another one")
    bench.app.state.access.authenticator.refresh(bench.store)
    assert bench.call("GET", "/api/v1/jobs", headers=headers).status_code == 401
    assert sign_in(bench, "ann", PASSWORD).status_code == 401
    assert sign_in(bench, "ann", "quite another one").status_code == 200


def test_delays_grow_with_each_wrong_attempt_and_end() -> None:
    now_s = 0.0
    tries = Tries(lambda: now_s)
    for _ in range(FREE_TRIES + 2):
        tries.note("ann", "a", right=False)
    assert tries.wait_s("ann", "a") == 4.0
    assert tries.wait_s("ben", "a") == 0.0
    assert tries.wait_s("ann", "b") == 0.0
    now_s = 4.1
    assert tries.wait_s("ann", "a") == 0.0
    for _ in range(10):
        tries.note("ann", "a", right=False)
    assert tries.wait_s("ann", "a") == pytest.approx(LONGEST_WAIT_S)
    tries.note("ann", "a", right=True)
    tries.note("ann", "a", right=False)
    assert tries.wait_s("ann", "a") == 0.0


def test_a_password_is_stored_salted_and_hashed() -> None:
    first, second = hashed(PASSWORD), hashed(PASSWORD)
    assert first != second
    assert fits(PASSWORD, first)
    assert not fits(PASSWORD + " ", first)


def test_users_are_managed_from_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def user(*words: str, typed: str = "") -> int:
        path = tmp_path / "typed"
        path.write_text(typed + "\n")
        with path.open() as stream:
            monkeypatch.setattr("sys.stdin", stream)
            return main(["key", *words, "--data", str(tmp_path)])

    assert user("add", "ann", "--password", "--scope", "operate", typed="short") == Exit.USAGE
    assert "5 characters" in capsys.readouterr().err
    assert user("add", "ann", "--password", "--scope", "operate", typed=PASSWORD) == Exit.DONE
    assert user("add", "ann", "--password", typed=PASSWORD) == Exit.FAILED
    assert user("password", "ben", typed=PASSWORD) == Exit.FAILED
    capsys.readouterr()
    assert user("add", "cell-7") == Exit.DONE
    capsys.readouterr()
    assert user("list", "--json") == Exit.DONE
    listed = {one["name"]: one["kind"] for one in json.loads(capsys.readouterr().out)}
    assert listed == {"cell-7": "key", "ann": "user"}
    assert PASSWORD not in (tmp_path / "keys.json").read_text()
    assert user("revoke", "ann") == Exit.DONE
    revoked = {row.name: row.revoked_at is not None for row in KeyFile(tmp_path).read()}
    assert revoked == {"cell-7": False, "ann": True}
