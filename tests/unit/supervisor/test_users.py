"""People who sign in by name and password, beside keys."""

from pathlib import Path

import httpx
import pytest

from pincette.cli import Exit
from pincette.cli.main import main
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.access.key_store import KeyStore
from pincette_supervisor.access.passwords import FREE_TRIES, Tries, fits, hashed
from pincette_supervisor.journal.access_rows import KeyRepository
from pincette_supervisor.journal.key_file import KeyFile
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.api import create_app
from pincette_supervisor.rest.session_cookie import NAME as COOKIE

from .harness import Harness

PASSWORD = "of ten and more"


@pytest.fixture
def bench(harness: Harness) -> Harness:
    """A supervisor that Ann may operate."""
    repository = KeyRepository(harness.store)
    KeyStore(repository).add_user("ann", "operate", PASSWORD)
    authenticator = Authenticator()
    authenticator.refresh(repository)
    harness.app = create_app(harness.rigs, Access(authenticator))
    return harness


def sign_in(bench: Harness, user: str, password: str) -> httpx.Response:
    return bench.post("/session", {"user": user, "password": password})


def test_who_did_what_has_the_name_of_a_person(bench: Harness) -> None:
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


def test_a_wrong_password_opens_nothing_and_soon_has_to_wait(bench: Harness) -> None:
    for user in ("ann", "nobody"):
        assert sign_in(bench, user, "another password").status_code == 401
    for _ in range(FREE_TRIES - 1):
        sign_in(bench, "ann", "another password")
    waits = sign_in(bench, "ann", PASSWORD)
    assert waits.status_code == 429
    assert int(waits.headers["Retry-After"]) >= 1


def test_another_password_ends_the_sessions(bench: Harness) -> None:
    signed = sign_in(bench, "ann", PASSWORD)
    headers = {"Cookie": f"{COOKIE}={signed.cookies[COOKIE]}"}
    repository = KeyRepository(bench.store)
    assert KeyStore(repository).set_password("ann", "quite another one")
    bench.app.state.access.authenticator.refresh(repository)
    assert bench.call("GET", "/api/v1/jobs", headers=headers).status_code == 401
    assert sign_in(bench, "ann", PASSWORD).status_code == 401
    assert sign_in(bench, "ann", "quite another one").status_code == 200


def test_waits_grow_with_each_wrong_try_and_end() -> None:
    now_s = 0.0
    tries = Tries(lambda: now_s)
    for _ in range(FREE_TRIES + 2):
        tries.note("ann", right=False)
    with pytest.raises(ProblemError, match="wait another 4 s"):
        tries.require("ann")
    tries.require("ben")
    now_s = 4.1
    tries.require("ann")
    tries.note("ann", right=True)
    tries.note("ann", right=False)
    tries.require("ann")


def test_a_password_is_kept_salted_and_hashed() -> None:
    first, second = hashed(PASSWORD), hashed(PASSWORD)
    assert first != second
    assert fits(PASSWORD, first)
    assert not fits(PASSWORD + " ", first)


def test_users_are_kept_from_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def user(*words: str, typed: str = "") -> int:
        path = tmp_path / "typed"
        path.write_text(typed + "\n")
        with path.open() as stream:
            monkeypatch.setattr("sys.stdin", stream)
            return main(["user", *words, "--data", str(tmp_path)])

    assert user("add", "ann", "--scope", "operate", typed="short") == Exit.USAGE
    assert "5 characters" in capsys.readouterr().err
    assert user("add", "ann", "--scope", "operate", typed=PASSWORD) == Exit.DONE
    assert user("add", "ann", typed=PASSWORD) == Exit.FAILED
    assert user("password", "ben", typed=PASSWORD) == Exit.FAILED
    capsys.readouterr()
    assert user("list") == Exit.DONE
    assert "ann" in capsys.readouterr().out
    assert PASSWORD not in (tmp_path / "keys.json").read_text()
    assert main(["key", "list", "--data", str(tmp_path)]) == Exit.DONE
    assert "ann" not in capsys.readouterr().out
    assert user("remove", "ann") == Exit.DONE
    (row,) = KeyFile(tmp_path).all()
    assert row.revoked_at is not None
