"""Servers besides the supervisor are reachable by others only if they require authentication."""

import pytest
from pydantic import ValidationError

from pincette.config.programs import Foxglove, Sila

PROVED = {"certificate": "pki/router.crt"}


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
def test_on_loopback_no_certificate_is_required(host: str) -> None:
    assert Sila(host=host).host == Foxglove(host=host).host == host


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.7", "bench"])
def test_beyond_loopback_a_certificate_is_required(host: str) -> None:
    for table in (Sila, Foxglove):
        with pytest.raises(ValidationError, match=r"without a certificate: .*state `certificate`"):
            table(host=host)
    assert Foxglove.model_validate({"host": host, **PROVED}).host == host


def test_a_server_that_can_move_the_arm_also_needs_a_login() -> None:
    wished = {"host": "192.0.2.7", **PROVED}
    with pytest.raises(ValidationError, match=r"without a login: .*state `login = true`"):
        Sila.model_validate(wished)
    assert Sila.model_validate({**wished, "login": True}).login
