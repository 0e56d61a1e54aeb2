"""A private authority: which certificates it signs, and their validity."""

from datetime import UTC, datetime, timedelta

import pytest

from pincette.security.certificates import Pair, belongs, issue, new_authority, read, signed_by
from pincette.security.identity import Identity, SecurityError, person, program, programs_of

NOW = datetime(2013, 4, 1, 12, tzinfo=UTC)
CONTROLLER = program("controller", "demo")
HOSTS = ("127.0.0.1", "bench", "::1")


@pytest.fixture(scope="module")
def authority() -> Pair:
    return new_authority(NOW, 100.0)


def test_a_certificate_states_name_hosts_and_expiry(authority: Pair) -> None:
    facts = read(issue(authority, CONTROLLER, HOSTS, NOW, 10.0).certificate)
    assert facts.identity == CONTROLLER
    assert set(facts.hosts) == set(HOSTS)
    assert facts.begins <= NOW
    assert facts.ends == NOW + timedelta(days=10)


def test_a_certificate_expires_no_later_than_its_authority(authority: Pair) -> None:
    facts = read(issue(authority, CONTROLLER, HOSTS, NOW, 1000.0).certificate)
    assert facts.ends == NOW + timedelta(days=100)


def test_the_certificate_of_a_person_has_no_host(authority: Pair) -> None:
    facts = read(issue(authority, person("anna", "viewer"), HOSTS, NOW, 10.0).certificate)
    assert facts.hosts == ()


def test_a_certificate_is_valid_for_its_own_authority_only(authority: Pair) -> None:
    other = new_authority(NOW, 100.0)
    pair = issue(authority, CONTROLLER, HOSTS, NOW, 10.0)
    assert signed_by(pair.certificate, authority.certificate)
    assert not signed_by(pair.certificate, other.certificate)
    assert read(authority.certificate).identity.name != read(other.certificate).identity.name


def test_a_private_key_is_accepted_with_its_own_certificate_only(authority: Pair) -> None:
    one, other = (issue(authority, CONTROLLER, HOSTS, NOW, 10.0) for _ in range(2))
    assert belongs(one)
    assert not belongs(Pair(one.certificate, other.private_key))


@pytest.mark.parametrize("text", [b"", b"-----BEGIN CERTIFICATE-----\nAAAA\n"])
def test_an_invalid_certificate_is_refused(text: bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        read(text)


@pytest.mark.parametrize("name", ["", "Left", "a/b", "..", "router", "authority", "x" * 32, "1a"])
def test_an_invalid_name_is_refused(name: str) -> None:
    with pytest.raises(SecurityError, match="cannot be the name of a rig"):
        programs_of(name)
    with pytest.raises(SecurityError, match="cannot be the name of a person"):
        person(name, "viewer")


def test_an_unknown_role_is_refused() -> None:
    with pytest.raises(SecurityError, match="'king'"):
        person("anna", "king")


def test_programs_shared_by_several_rigs_have_no_rig_in_their_identity() -> None:
    assert program("router", "demo") == Identity("router", "router")
    assert program("supervisor", "demo").rig == ""
    assert CONTROLLER.rig == "demo"
