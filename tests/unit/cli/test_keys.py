"""Keys from the command line: made and revoked in a data folder, sent to a supervisor."""

import json
from pathlib import Path
from typing import Any

import pytest

from pincette.api.access import AuditEntry
from pincette.cli import Exit
from pincette.cli.main import main
from pincette.client import Supervisor
from tests.unit.client import desk
from tests.unit.client.desk import Desk

from .conftest import At

KEY = "pincette_secret"


@pytest.fixture(autouse=True)
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ensure that the user's own key is not read."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("PINCETTE_KEY", raising=False)


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[str | None]:
    """Keys that the command line has sent to a supervisor."""
    found: list[str | None] = []

    def reached(_url: str, *, key: str | None, **_settings: Any) -> Supervisor:
        found.append(key)
        return Desk(desk.rig(), desk.rig()).supervisor(0.0)

    monkeypatch.setattr("pincette.client.Supervisor", reached)
    return found


def keys(data: Path, *words: str) -> int:
    return main(["key", *words, "--data", str(data)])


def test_a_key_is_shown_once_and_listed_without_its_secret(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "data"
    assert keys(data, "list") == Exit.DONE
    assert "no key" in capsys.readouterr().out
    assert keys(data, "add", "cell-7", "--scope", "operate", "--days", "30") == Exit.DONE
    made = capsys.readouterr()
    key = made.out.strip()
    assert key.startswith("pincette_")
    assert "within a second" in made.err
    assert key not in made.err
    assert keys(data, "list", "--json") == Exit.DONE
    output = capsys.readouterr().out
    (listed,) = json.loads(output)
    assert (listed["name"], listed["scope"], listed["usable"]) == ("cell-7", "operate", True)
    assert listed["expires_at"] > listed["made_at"]
    assert key not in output
    assert "digest" not in listed
    assert keys(data, "revoke", "cell-7") == Exit.DONE
    assert "Valid: none" in capsys.readouterr().out
    assert keys(data, "list") == Exit.DONE
    assert "revoked" in capsys.readouterr().out


def test_listing_keys_fails_if_their_file_is_lost(tmp_path: Path) -> None:
    assert keys(tmp_path, "list") == Exit.DONE
    assert keys(tmp_path, "add", "ann") == Exit.DONE
    (tmp_path / "keys.json").unlink()
    assert keys(tmp_path, "list") == Exit.FAILED


def test_impossible_input_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert keys(tmp_path, "add", "ann") == Exit.DONE
    assert keys(tmp_path, "add", "ann") == Exit.FAILED
    assert "take another name" in capsys.readouterr().err
    assert keys(tmp_path, "revoke", "bob") == Exit.FAILED
    assert "no key or user 'bob' is valid" in capsys.readouterr().err
    assert keys(tmp_path, "add", "eve", "--days", "0") == Exit.USAGE
    assert keys(tmp_path, "add", "Ann (admin)") == Exit.USAGE
    (tmp_path / "supervisor.sqlite").write_text("no journal")
    assert keys(tmp_path, "list") == Exit.DONE  # keys have a file of their own
    (tmp_path / "keys.json").unlink()
    assert keys(tmp_path, "list") == Exit.FAILED


def key_file(path: Path, mode: int = 0o600) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{KEY}\n", encoding="utf-8")
    path.chmod(mode)
    return path


def test_the_key_is_taken_from_option_environment_or_file_in_this_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shown: list[str | None]
) -> None:
    file = key_file(tmp_path / "key")
    usual = tmp_path / "config/pincette/key"
    wanted: list[str | None] = []
    for named, variable, has_usual, key in (
        (None, None, False, None),
        (None, None, True, KEY),
        (None, "of-the-environment", True, "of-the-environment"),
        (None, f"@{file}", False, KEY),
        ("named", "of-the-environment", True, "named"),
        (f"@{file}", None, False, KEY),
    ):
        if has_usual:
            key_file(usual)
        else:
            usual.unlink(missing_ok=True)
        if variable is None:
            monkeypatch.delenv("PINCETTE_KEY", raising=False)
        else:
            monkeypatch.setenv("PINCETTE_KEY", variable)
        main(["model", "show", "--rig-name", "demo", *(["--key", named] if named else [])])
        wanted.append(key)
    assert shown == wanted


@pytest.mark.parametrize(
    ("mode", "text", "words"),
    [
        (0o644, KEY, "others may read it: chmod 600"),
        (0o600, "", "is empty"),
        (0o600, "two words", "no blanks|without blanks"),
        (None, KEY, "cannot be read"),
    ],
)
def test_a_key_file_that_cannot_be_used_is_reported(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    mode: int | None,
    text: str,
    words: str,
) -> None:
    path = tmp_path / "key"
    if mode is not None:
        path.write_text(text)
        path.chmod(mode)
    assert main(["model", "show", "--rig-name", "demo", "--key", f"@{path}"]) == Exit.USAGE
    output = capsys.readouterr().err
    assert any(word in output for word in words.split("|")), output
    assert KEY not in output
    assert "two words" not in output


def test_a_key_with_too_few_rights_is_reported_with_the_missing_right(
    at: At, capsys: pytest.CaptureFixture[str]
) -> None:
    detail = "this needs scope operate (also plan …); key 'ann' has observe"
    at(desk.problem(403, "scope-too-small", needed_scope="operate", detail=detail))
    assert main(["job", "grip", "--rig-name", "demo", "--no-wait"]) == Exit.FAILED
    assert detail in capsys.readouterr().err


def test_the_audit_log_is_listed(at: At, capsys: pytest.CaptureFixture[str]) -> None:
    entry = desk.example(AuditEntry, count=3)
    answers = [desk.httpx.Response(200, json={"entries": [entry], "next": None})] * 2
    supervisor = at(*answers)
    assert main(["audit", "--limit", "5", "--before", "13"]) == Exit.DONE
    output = capsys.readouterr().out
    assert "cell-7 (Ann)" in output
    assert dict(supervisor.asked[0].url.params) == {"limit": "5", "before": "13"}
    assert main(["audit", "--json"]) == Exit.DONE
    assert json.loads(capsys.readouterr().out) == [entry]
