"""`pincette security`: folders of certificates from the command line, and the findings of
doctor."""

import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from pincette.cli import PKI, opened, security
from pincette.cli.main import main
from pincette.config import RigFile
from pincette.diagnostics.certificates import certificates
from pincette.security.folder import Folder
from pincette.security.identity import person, program
from pincette.security.revocation import read_revoked
from tests.support.certificates import NOW, folder_for
from tests.support.command_line import parsed
from tests.support.rigs import DEMO, demo_rig

Said = Callable[..., str]


@pytest.fixture
def said(capsys: pytest.CaptureFixture[str]) -> Said:
    """Return the output of a command line, after checking its exit status."""

    def run(*words: str | Path, status: int = 0) -> str:
        assert main(["security", *map(str, words)]) == status
        captured = capsys.readouterr()
        return captured.err if status else captured.out

    return run


def test_init_makes_all_certificates_and_explains_their_use(said: Said, tmp_path: Path) -> None:
    place = tmp_path / "pki"
    text = said("init", place, "--rig", "left", "--rig", "right", "--host", "bench")
    folder = Folder(place)
    assert folder.rigs() == ("left", "right")
    assert folder.facts(program("actuator", "right")).hosts == ("bench",)
    for facts in folder.all():
        assert facts.identity.name in text
    assert f'pki = "{place}"' in text
    assert "authority.key" in text
    assert "is not empty" in said("init", place, "--rig", "left", status=1)


def test_without_a_name_the_rig_file_names_the_rig(
    said: Said, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PINCETTE_RIG", str(DEMO))
    said("init", tmp_path / "pki")
    assert Folder(tmp_path / "pki").rigs() == ("demo",)


def test_adding_and_revoking_state_what_to_restart(said: Said, tmp_path: Path) -> None:
    folder = folder_for(tmp_path / "pki", "left")
    assert "restart the router" in said("add", folder.path, "right")
    assert folder.rigs() == ("left", "right")
    assert "actuator" not in said("issue", folder.path, "anna", "--role", "viewer")
    assert "each actuator" in said("issue", folder.path, "otto", "--role", "operator")
    assert folder.named("otto").role == "operator"
    otto, sensor = folder.facts(person("otto", "operator")), folder.facts(program("sensor", "left"))
    assert f"copy {folder.path}/revoked" in said("revoke", folder.path, "otto")
    assert "'otto' has no certificate" in said("revoke", folder.path, "otto", status=1)
    assert "restart it with the new one" in said("revoke", folder.path, "left/sensor")
    assert folder.facts(program("sensor", "left")).serial != sensor.serial
    assert read_revoked(folder.path) == {otto.serial, sensor.serial}


def test_a_lost_revocation_list_is_replaced_only_on_request(said: Said, tmp_path: Path) -> None:
    folder = folder_for(tmp_path / "pki", "left")
    revoked = folder.path / "revoked"
    said("revoke", folder.path, "viewer")
    assert "in order, with 1 certificates" in said("revoke", folder.path, "--anew", status=1)
    revoked.write_text("cut\n")
    assert "is damaged" in said("revoke", folder.path, "operator", status=1)
    assert folder.named("operator"), "a certificate that could not be revoked must remain"
    assert "accepted again" in said("revoke", folder.path, "--anew")
    assert read_revoked(folder.path) == frozenset()
    for words in ((), ("operator", "--anew")):
        assert "either the NAME" in said("revoke", folder.path, *words, status=1)


def test_renew_renews_the_named_or_the_expiring_certificates(said: Said, tmp_path: Path) -> None:
    folder = folder_for(tmp_path / "pki", "left", days=90.0)
    assert "none expires within 30 days" in said("renew", folder.path)
    sensor = program("sensor", "left")
    folder.renew(sensor, NOW, 5.0)
    assert "renewed: left/sensor\n" in said("renew", folder.path)
    assert folder.facts(sensor).ends > NOW + timedelta(days=700)
    assert "renewed: viewer\n" in said("renew", folder.path, "viewer", "--days", "9")
    assert "must be above 0" in said("renew", folder.path, "viewer", "--days", "0", status=1)


def test_show_lists_names_expiry_and_hosts(said: Said, tmp_path: Path) -> None:
    folder = folder_for(tmp_path / "pki", "left", days=90.0)
    folder.renew(program("sensor", "left"), NOW, 5.0)
    rows = {row["name"]: row for row in json.loads(said("show", folder.path, "--json"))}
    assert rows["left/sensor"]["state"] == "expires soon"
    assert rows["left/actuator"] == {
        "name": "left/actuator",
        "role": "actuator",
        "begins": rows["left/actuator"]["begins"],
        "ends": (NOW + timedelta(days=90)).replace(microsecond=0).isoformat(),
        "state": "good",
        "hosts": ["localhost", "127.0.0.1"],
    }
    assert "left/sensor " in said("show", folder.path)
    folder.renew(program("sensor", "left"), NOW - timedelta(days=9), 5.0)
    assert main(["security", "show", str(folder.path)]) == 1


def test_an_invalid_folder_is_reported_with_a_readable_message(said: Said, tmp_path: Path) -> None:
    assert "authority.crt: No such file" in said("show", tmp_path, status=1)


def test_the_environment_names_a_folder_in_place_of_the_rig_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert opened(DEMO).bus.pki is None
    monkeypatch.setenv(PKI, str(tmp_path))
    assert opened(DEMO).bus.pki == str(tmp_path)


class TestOnTheFly:
    def test_certificates_of_a_demo_are_deleted_afterwards(self) -> None:
        rig = demo_rig()
        with security.temporary_certificates(rig) as place:
            assert Folder(place).rigs() == ("demo",)
            assert Folder(place).facts(program("router", "")).hosts == (rig.bus.host,)
        assert not place.exists()

    def test_certificates_beside_the_records_are_kept_and_extended_for_another_rig(
        self, tmp_path: Path
    ) -> None:
        place = security.made_certificates(demo_rig(), tmp_path)
        before = Folder(place).credentials(program("sensor", "demo")).certificate.read_bytes()
        other = demo_rig({"rig": {"name": "right"}})
        assert security.made_certificates(demo_rig(), tmp_path) == place
        assert security.made_certificates(other, tmp_path) == place
        assert Folder(place).rigs() == ("demo", "right")
        after = Folder(place).credentials(program("sensor", "demo")).certificate.read_bytes()
        assert after == before

    @pytest.mark.parametrize("word", ["up", "demo"])
    def test_a_single_flag_creates_the_certificates(self, word: str) -> None:
        assert parsed(word, "--secure").params["secure"]
        assert not parsed(word).params["secure"]


class TestDoctor:
    def rig(self, folder: Folder) -> RigFile:
        return demo_rig().secured(folder.path)

    def says(self, rig: RigFile, now: datetime | None = None) -> list[tuple[str, str]]:
        return [(finding.mark, finding.what) for finding in certificates(rig, now)]

    def test_a_rig_on_loopback_without_certificates_gives_no_finding(self) -> None:
        assert self.says(demo_rig()) == []

    def test_an_open_rig_beyond_loopback_is_reported(self) -> None:
        ((mark, what),) = self.says(demo_rig({"bus": {"host": "192.0.2.1"}}))
        assert mark == "note"
        assert "192.0.2.1" in what

    def test_valid_certificates_are_reported(self, tmp_path: Path) -> None:
        folder = folder_for(tmp_path / "pki", "demo", days=90.0)
        ((mark, what),) = self.says(self.rig(folder))
        assert mark == "ok"
        assert f"{NOW + timedelta(days=90):%Y-%m-%d}" in what

    def test_expiring_certificates_are_reported(self, tmp_path: Path) -> None:
        folder = folder_for(tmp_path / "pki", "demo", days=90.0)
        ((mark, what),) = self.says(self.rig(folder), NOW + timedelta(days=61))
        assert mark == "note"
        assert "28 days left" in what or "29 days left" in what

    def test_expired_missing_and_misplaced_certificates_are_reported(self, tmp_path: Path) -> None:
        folder = folder_for(tmp_path / "pki", "demo", days=90.0)
        rig = self.rig(folder)
        late = datetime.now(UTC) + timedelta(days=91)
        assert {mark for mark, _ in self.says(rig, late)} == {"missing"}
        folder.credentials(program("sensor", "demo")).certificate.unlink()
        assert any("sensor.crt: No such file" in what for _, what in self.says(rig))
        bus = rig.bus.model_copy(update={"host": "192.0.2.1"})
        stated = self.says(rig.model_copy(update={"bus": bus}))
        assert ("missing", "192.0.2.1") in {
            (mark, "192.0.2.1") for mark, what in stated if "is reached at 192.0.2.1" in what
        }

    def test_a_lost_revocation_list_is_reported(self, tmp_path: Path) -> None:
        folder = folder_for(tmp_path / "pki", "demo", days=90.0)
        (folder.path / "revoked").unlink()
        ((mark, what),) = self.says(self.rig(folder))
        assert mark == "missing"
        assert f"{folder.path}/revoked: No such file" in what

    def test_the_key_of_a_program_on_another_host_is_not_required_here(
        self, tmp_path: Path
    ) -> None:
        folder = folder_for(tmp_path / "pki", "demo", days=90.0)
        folder.credentials(program("sensor", "demo")).private_key.unlink()
        assert [mark for mark, _ in self.says(self.rig(folder))] == ["ok"]
