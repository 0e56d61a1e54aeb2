"""Actions are logged with their caller, unknown clients fill no log, and a changed log is found."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from pincette_supervisor.journal.access import AuditRepository, AuditRow
from tests.support.keys import ScopeKeys

from .harness import Harness


def audit(harness: Harness, ring: ScopeKeys, **query: Any) -> list[dict[str, Any]]:
    answer = harness.call("GET", "/api/v1/audit", headers=ring.headers("admin"), params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()["entries"]


def test_actions_are_stored(harness: Harness, ring: ScopeKeys) -> None:
    headers = ring.headers("operate")
    body = {"kind": "grip", "dry_run": True}
    harness.call("POST", "/api/v1/jobs", json=body, headers=headers)
    made = harness.call("POST", "/api/v1/jobs", json={"kind": "grip"}, headers=headers).json()["id"]
    harness.reach(made, "ready")
    harness.call("POST", f"/api/v1/jobs/{made}/actions", json={"type": "stop"}, headers=headers)
    harness.call("POST", "/api/v1/estop", headers=ring.headers("observe"))
    harness.call("GET", "/api/v1/rigs", headers=headers)
    found = [
        (one["who"], one["action"], one["detail"], one["status"]) for one in audit(harness, ring)
    ]
    assert found == [
        ("an-observe", "POST /api/v1/estop", "", 200),
        ("an-operate", f"POST /api/v1/jobs/{made}/actions", "stop", 202),
        ("an-operate", "POST /api/v1/jobs", f"grip {made}", 201),
    ]
    first = audit(harness, ring, limit=1)
    assert len(first) == 1
    rest = audit(harness, ring, before=first[0]["number"])
    assert [one["number"] for one in rest] == [2, 1]


def test_many_refused_requests_of_an_unknown_client_fill_one_row_of_the_audit_log(
    harness: Harness, ring: ScopeKeys
) -> None:
    for number in range(50):
        headers = {"X-Operator": f"an-admin {number}"}
        harness.call("GET", f"/api/v1/jobs/{number}", headers=headers)
    (entry,) = audit(harness, ring)
    assert (entry["who"], entry["status"], entry["count"]) == ("127.0.0.1", 401, 50)


def test_the_audit_log_is_append_only(harness: Harness, ring: ScopeKeys, tmp_path: Path) -> None:
    harness.call("POST", "/api/v1/estop", headers=ring.headers("observe"))
    assert len(audit(harness, ring)) == 1
    with closing(sqlite3.connect(tmp_path / "supervisor.sqlite")) as base:
        for change in ("UPDATE audit SET who = 'nobody'", "DELETE FROM audit"):
            with pytest.raises(sqlite3.IntegrityError, match="audit log"):
                base.execute(change)
    assert audit(harness, ring)[0]["who"] == "an-observe"


def test_stops_of_an_unknown_client_are_logged_once_beside_those_of_others(
    harness: Harness, ring: ScopeKeys
) -> None:
    for _ in range(50):
        assert harness.call("POST", "/api/v1/estop").status_code == 200
    harness.call("POST", "/api/v1/estop", headers=ring.headers("observe"))
    found = {(one["who"], one["action"], one["count"]) for one in audit(harness, ring)}
    assert found == {
        ("127.0.0.1", "POST /api/v1/estop", 50),
        ("an-observe", "POST /api/v1/estop", 1),
    }


def chain(harness: Harness, ring: ScopeKeys, **query: str) -> dict[str, Any]:
    headers = ring.headers("admin")
    answer = harness.call("GET", "/api/v1/audit/chain", headers=headers, params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()


TRIGGERS = ("audit_is_append_only", "audit_keeps_the_newest")
DAMAGES = [
    ("UPDATE audit SET who = 'nobody' WHERE number = 3", 3),
    ("UPDATE audit SET status = 403 WHERE number = 5", 5),
    ("UPDATE audit SET count = 2 WHERE number = 2", 2),
    ("DELETE FROM audit WHERE number = 3", 4),
    ("UPDATE audit SET link = 'x' WHERE number = 4", 4),
    ("UPDATE audit SET number = 9 WHERE number = 5", 9),
    (
        "UPDATE audit SET number = 8 WHERE number = 3; "
        "UPDATE audit SET number = 3 WHERE number = 4; "
        "UPDATE audit SET number = 4 WHERE number = 8",
        3,
    ),
]


@pytest.mark.parametrize(("damage", "broken"), DAMAGES)
def test_a_changed_entry_of_the_file_is_found(
    harness: Harness, ring: ScopeKeys, tmp_path: Path, damage: str, broken: int
) -> None:
    for _ in range(5):
        harness.call("POST", "/api/v1/estop", headers=ring.headers("observe"))
    whole = chain(harness, ring)
    assert (whole["entries"], whole["first"], whole["newest"]) == (5, 1, 5)
    assert whole["broken"] is None
    with closing(sqlite3.connect(tmp_path / "supervisor.sqlite")) as base:
        for trigger in TRIGGERS:
            base.execute(f"DROP TRIGGER {trigger}")
        base.executescript(damage)
        base.commit()
    assert chain(harness, ring)["broken"] == broken


def test_a_rewritten_audit_log_lacks_the_hash_that_was_noted_before(
    harness: Harness, ring: ScopeKeys
) -> None:
    harness.call("POST", "/api/v1/estop", headers=ring.headers("observe"))
    noted = chain(harness, ring)["link"]
    harness.call("POST", "/api/v1/estop", headers=ring.headers("operate"))
    assert chain(harness, ring, link=noted)["found"] is True
    assert chain(harness, ring, link="0" * 64)["found"] is False
    assert chain(harness, ring)["found"] is None


MANY = """
WITH RECURSIVE counted(number) AS (SELECT 1 UNION ALL SELECT number + 1 FROM counted LIMIT 200004)
INSERT INTO audit (at, who, address, action, detail, status, count, link)
SELECT '2026-03-01T12:00:00.000Z', 'ann', '127.0.0.1', 'POST /estop', '', 200, 1, '' FROM counted
"""


def test_the_oldest_of_very_many_entries_are_deleted(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pincette_supervisor.journal.access.AUDIT_SWEEP", 0)
    with harness.store.writing() as base:
        base.exec_driver_sql(MANY)
    AuditRepository(harness.store).add(
        [AuditRow("2026", "ann", "127.0.0.1", "POST /estop", "", 200)]
    )
    with harness.store.reading() as base:
        count = base.exec_driver_sql("SELECT count(*), min(number) FROM audit").one()
    assert tuple(count) == (200_000, 6)
