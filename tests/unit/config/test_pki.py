"""The folder of certificates matters only to one machine: it is not sent, and not part of the
digest."""

from pathlib import Path

from pincette.config import parse_rig_json, read_rig
from tests.support.rigs import DEMO, demo_rig, rig_toml


def test_the_folder_is_relative_to_the_rig_file(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(f'base = "{DEMO}"\n[bus]\npki = "certificates"\n', encoding="utf-8")
    assert read_rig(path).bus.pki == str(tmp_path / "certificates")
    path.write_text(f'base = "{DEMO}"\n[bus]\npki = "/etc/pki"\n', encoding="utf-8")
    assert read_rig(path).bus.pki == "/etc/pki"


def test_the_certificate_folder_changes_no_digest_and_is_not_published(tmp_path: Path) -> None:
    plain = demo_rig()
    secured = plain.secured(tmp_path)
    assert secured.digest() == plain.digest()
    reported = secured.model_dump_json()
    assert str(tmp_path) not in reported
    assert parse_rig_json(reported) == plain
    assert "pki" not in rig_toml(secured)
