"""A SiLA login requires a key of the supervisor."""

from typing import Any, cast

import pytest
from sila2.features.authenticationservice import AuthenticationFailed

from pincette.api.access import Scope, Session
from pincette_sila.background import Background
from pincette_sila.callers import Callers


class Answered:
    """Background work whose calls all return the same reply."""

    def __init__(self, answer: Session) -> None:
        self._answer = answer

    def call(self, asked: Any) -> Session:
        asked.close()
        return self._answer


def callers(*, keys: bool, scope: Scope | None) -> Callers:
    session = Session(keys=keys, name=None, scope=scope, signed_in=False)
    background = cast(Background, Answered(session))
    return Callers("http://127.0.0.1:9", "demo", None, None, background)


def test_without_keys_at_the_supervisor_no_user_can_log_in() -> None:
    """Without keys the supervisor permits every request, so it cannot verify a password."""
    with pytest.raises(AuthenticationFailed, match="no keys; make one"):
        callers(keys=False, scope="admin").log_in("ada", "word")


def test_an_unknown_key_cannot_log_in() -> None:
    with pytest.raises(AuthenticationFailed, match="does not know"):
        callers(keys=True, scope=None).log_in("ada", "word")


def test_a_key_gives_a_token() -> None:
    known = callers(keys=True, scope="operate")
    token = known.log_in("ada", "key")
    known.check(token)
    assert known.log_out(token)
