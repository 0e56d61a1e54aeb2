"""The address on which the router listens for others matters only to its machine."""

from pathlib import Path

import pytest

from pincette.bus.endpoints import router_endpoint, service_endpoint
from pincette.bus.topology import SessionConfig
from pincette.config import parse_rig_json, read_rig
from pincette.diagnostics.certificates import certificates
from pincette.engine.process import loop_programs
from tests.support.rigs import DEMO


def test_the_router_listens_at_the_given_address_and_its_programs_on_loopback() -> None:
    plain = read_rig(DEMO)
    heard = plain.listening("0.0.0.0")
    assert router_endpoint(plain) == SessionConfig("router", listen=("tcp/127.0.0.1:7447",))
    assert router_endpoint(heard).listen == ("tcp/0.0.0.0:7447",)
    programs = loop_programs(plain)
    for name in programs:
        assert service_endpoint(heard, name, programs) == service_endpoint(plain, name, programs)


def test_the_rig_file_can_set_the_address(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(f'base = "{DEMO}"\n[bus]\nlisten = "0.0.0.0"\n', encoding="utf-8")
    assert read_rig(path) == read_rig(DEMO).listening("0.0.0.0")


def test_the_listen_address_changes_no_digest_and_is_not_published() -> None:
    plain = read_rig(DEMO)
    heard = plain.listening("192.0.2.7")
    assert heard.digest() == plain.digest()
    assert parse_rig_json(heard.model_dump_json()) == plain


@pytest.mark.parametrize(("address", "said"), [("127.0.0.2", 0), ("0.0.0.0", 1)])
def test_doctor_reports_an_open_router(address: str, said: int) -> None:
    found = list(certificates(read_rig(DEMO).listening(address)))
    assert len(found) == said
    assert all("[bus] listen = '0.0.0.0'" in finding.what for finding in found)
