"""The folder of certificates: nothing is overwritten, secrets are private, faults are named."""

import stat
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from pincette.security.establishing import README, due, enrol, establish
from pincette.security.folder import SOON, Folder, checked
from pincette.security.identity import OF_A_RIG, SecurityError, person, program

NOW = datetime(2013, 4, 1, 12, tzinfo=UTC)
CONTROLLER = program("controller", "demo")


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    made = Folder(tmp_path / "pki")
    establish(made, ["demo"], [], NOW, 100.0)
    return made


def test_a_new_folder_has_all_certificates_of_a_rig(folder: Folder) -> None:
    names = {facts.identity.name for facts in folder.all()}
    own = {f"demo/{name}" for name in OF_A_RIG}
    assert names == {"router", "supervisor", "viewer", "operator", *own}
    for facts in folder.all():
        assert checked(folder.credentials(facts.identity), NOW) == facts
    assert folder.rigs() == ("demo",)


def test_secrets_are_readable_by_their_owner_only(folder: Folder) -> None:
    keys = list(folder.path.rglob("*.key"))
    assert len(keys) == 11
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys} == {0o600}
    folders = [folder.path, folder.path / "demo"]
    assert {stat.S_IMODE(one.stat().st_mode) for one in folders} == {0o700}


def test_every_file_is_explained(folder: Folder) -> None:
    text = (folder.path / README).read_text(encoding="utf-8")
    for name in ("authority.key", "router", "supervisor", "viewer", "operator", "RIG/PROGRAM"):
        assert name in text


def test_a_folder_that_is_not_empty_is_not_changed(folder: Folder) -> None:
    before = {path: path.read_bytes() for path in folder.path.rglob("*") if path.is_file()}
    with pytest.raises(SecurityError, match="not empty"):
        establish(folder, ["demo"], [], NOW)
    with pytest.raises(SecurityError, match="overwritten"):
        folder.issue(CONTROLLER, [], NOW, 10.0)
    assert before == {path: path.read_bytes() for path in before}


def test_an_invalid_name_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(SecurityError, match="cannot be the name"):
        establish(Folder(tmp_path / "pki"), ["demo", "Left"], [], NOW)
    assert list(tmp_path.iterdir()) == []


def test_another_rig_and_another_person_can_be_added_later(folder: Folder) -> None:
    enrol(folder, "right", ["bench"], NOW)
    folder.issue(person("anna", "operator"), [], NOW, 10.0)
    assert folder.rigs() == ("demo", "right")
    assert folder.named("anna").role == "operator"
    assert folder.facts(program("sensor", "right")).hosts == ("bench",)
    with pytest.raises(SecurityError, match="exists already"):
        enrol(folder, "right", [], NOW)


def test_a_removed_name_is_unknown(folder: Folder) -> None:
    folder.remove(folder.named("viewer"))
    with pytest.raises(SecurityError, match="'viewer' has no certificate"):
        folder.named("viewer")


def test_a_renewed_certificate_has_another_key_and_the_same_hosts(folder: Folder) -> None:
    files = folder.credentials(CONTROLLER)
    key, before = files.private_key.read_bytes(), folder.facts(CONTROLLER)
    folder.renew(CONTROLLER, NOW + timedelta(days=50), 100.0)
    after = checked(files, NOW + timedelta(days=50))
    assert files.private_key.read_bytes() != key
    assert stat.S_IMODE(files.private_key.stat().st_mode) == 0o600
    assert after.ends == before.ends + timedelta(days=50)
    assert after.hosts == before.hosts


def test_certificates_that_expire_soon_are_listed_for_renewal(folder: Folder) -> None:
    end = folder.facts(CONTROLLER).ends
    assert list(due(folder, end - SOON)) == []
    assert CONTROLLER in due(folder, end - SOON + timedelta(seconds=1))


def test_certificates_of_another_authority_are_ignored(folder: Folder, tmp_path: Path) -> None:
    other = Folder(tmp_path / "other")
    establish(other, ["right"], [], NOW)
    (other.path / "right").rename(folder.path / "right")
    assert folder.rigs() == ("demo",)


def test_a_certificate_stored_under_another_name_is_ignored(folder: Folder) -> None:
    place = folder.path / "viewer.crt"
    place.rename(folder.path / "operator.crt")
    assert not any(facts.identity.role == "operator" for facts in folder.all())


class TestWhatIsNotInOrder:
    def refused(self, folder: Folder, words: str, now: datetime = NOW) -> None:
        with pytest.raises(SecurityError, match=words):
            checked(folder.credentials(CONTROLLER), now)

    def test_a_missing_file_is_refused(self, folder: Folder) -> None:
        folder.credentials(CONTROLLER).private_key.unlink()
        self.refused(folder, r"controller\.key: No such file")

    def test_a_file_without_a_certificate_is_refused(self, folder: Folder) -> None:
        folder.credentials(CONTROLLER).certificate.write_text("hello")
        self.refused(folder, r"controller\.crt: ")

    def test_a_certificate_of_another_authority_is_refused(
        self, folder: Folder, tmp_path: Path
    ) -> None:
        other = Folder(tmp_path / "other")
        establish(other, ["demo"], [], NOW)
        (other.path / "authority.crt").replace(folder.path / "authority.crt")
        self.refused(folder, "another authority")

    def test_a_certificate_of_another_program_is_refused(self, folder: Folder) -> None:
        other = folder.credentials(program("sensor", "demo"))
        other.certificate.replace(folder.credentials(CONTROLLER).certificate)
        self.refused(folder, "is the certificate of demo/sensor .* not of demo/controller")

    def test_a_certificate_with_another_key_is_refused(self, folder: Folder) -> None:
        files = folder.credentials(CONTROLLER)
        other = folder.credentials(program("sensor", "demo"))
        other.private_key.replace(files.private_key)
        self.refused(folder, "is not the key of")

    def test_an_expired_certificate_is_refused(self, folder: Folder) -> None:
        end = folder.facts(CONTROLLER).ends
        assert checked(folder.credentials(CONTROLLER), end - timedelta(seconds=1))
        self.refused(
            folder, "expired on 2013-07-10: `pincette security renew .* demo/controller`", end
        )

    def test_a_certificate_that_is_not_valid_yet_is_refused(self, folder: Folder) -> None:
        self.refused(folder, "valid from .* set this machine's clock", NOW - timedelta(days=1))

    def test_a_certificate_of_another_role_is_refused(self, folder: Folder) -> None:
        files = replace(
            folder.credentials(person("viewer", "viewer")), identity=person("viewer", "operator")
        )
        with pytest.raises(SecurityError, match=r"viewer \(viewer\), not of viewer \(operator\)"):
            checked(files, NOW)
