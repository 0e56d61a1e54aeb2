"""Revoked certificates: their links end, and no damage to the revocation list lets them in
again."""

import re
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.bus.protocol import BusError
from pincette.bus.session import open_session
from pincette.bus.topology import TlsIdentity, client_session, secured
from pincette.security.access import client_access
from pincette.security.identity import Credentials, SecurityError
from tests.support.certificates import folder_for
from tests.support.doors import OPENS_S, ROUTER, TOOL, Door

pytestmark = pytest.mark.usefixtures("stalls")

REVOKED_WITHIN_S = 2.0


def test_a_revoked_certificate_is_disconnected_and_stays_refused(tmp_path: Path) -> None:
    folder = folder_for(tmp_path / "pki", "demo")
    door = Door(folder)
    viewer, revoked = folder.named("viewer"), tmp_path / "pki" / "revoked"
    own = secured(
        client_session("127.0.0.1", door.port),
        TlsIdentity(folder.credentials(TOOL), client_access(ROUTER)),
    )
    copies = [tmp_path / name for name in ("crt", "key")]
    theirs = folder.credentials(viewer)
    for copy, place in zip(copies, (theirs.certificate, theirs.private_key), strict=True):
        copy.write_bytes(place.read_bytes())
    kept = Credentials(viewer, theirs.authority, *copies)
    joins = secured(
        client_session("127.0.0.1", door.port), TlsIdentity(kept, client_access(ROUTER))
    )
    try:
        with open_session(own, "tool"), open_session(joins, "viewer"):
            assert len(door.router.session.info.links()) == 2
            folder.revoke(viewer)
            deadline = monotonic() + REVOKED_WITHIN_S
            while len(door.router.session.info.links()) > 1:
                assert monotonic() < deadline
                sleep(0.02)
        for damage in (lambda: None, lambda: revoked.write_text(""), revoked.unlink):
            damage()
            with pytest.raises(BusError, match="viewer"):
                open_session(joins, "viewer")
        assert door.opened_s() < OPENS_S
    finally:
        door.router.close()


def test_without_the_revocation_list_no_program_listens(tmp_path: Path) -> None:
    """A lost or truncated list is not treated as an empty one, neither by a start nor by a
    revocation."""
    folder = folder_for(tmp_path / "pki", "demo")
    for name in ("viewer", "operator"):
        folder.revoke(folder.named(name))
    revoked = tmp_path / "pki" / "revoked"
    whole = revoked.read_bytes()
    first = whole.index(b"\n") + 1
    damaged = [whole[:size] for size in (0, first, first + 5, len(whole) - 1)]
    damaged += [whole[first:], whole.replace(b"viewer", b"vie\xffer"), b"no number\n", b"0" + whole]
    for content in (*damaged, None):
        revoked.unlink() if content is None else revoked.write_bytes(content)
        for what in (
            lambda: Door(folder),
            lambda: folder.replace(folder.named("demo/sensor"), datetime.now(UTC), 9.0),
        ):
            with pytest.raises(SecurityError, match=rf"{re.escape(str(revoked))}.*--anew"):
                what()
    revoked.write_bytes(whole)
    Door(folder).router.close()
