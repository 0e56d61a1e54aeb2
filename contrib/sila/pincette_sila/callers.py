"""Callers of commands: this server with its own key, or a SiLA client that has logged in with a
key.
"""

import secrets
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast
from uuid import UUID

from sila2.features.authenticationservice import (
    AuthenticationFailed,
    AuthenticationServiceBase,
    Login_Responses,
    Logout_Responses,
)
from sila2.features.authenticationservice import InvalidAccessToken as UnknownToken
from sila2.features.authorizationservice import (
    AuthorizationServiceBase,
    AuthorizationServiceFeature,
    InvalidAccessToken,
)
from sila2.framework import Command
from sila2.server import MetadataDict, MetadataInterceptor, SilaServer

from pincette.client import AsyncRigHandle, AsyncSupervisor, ClientError
from pincette_sila.background import Background
from pincette_sila.errors import CommandError

LIFETIME_S = 3600
"""Lifetime of an unused login, in s."""
MOST_LOGINS = 100


@dataclass(slots=True)
class _Login:
    supervisor: AsyncSupervisor
    until_s: float


class Callers:
    """Supervisor with the permissions of this server or of a logged-in client."""

    def __init__(
        self,
        url: str,
        rig: str,
        key: str | None,
        authority: Path | None,
        background: Background,
    ) -> None:
        """Prepare the client; ``authority`` is the trusted certificate of a supervisor that uses
        TLS.
        """
        self._url, self._rig, self._authority = url, rig, authority
        self._background = background
        self.supervisor = self._supervisor(key, "sila")
        self._logins: dict[str, _Login] = {}

    def rig(self, metadata: MetadataDict | None = None) -> AsyncRigHandle:
        """Return the rig with the permissions of the caller of a command."""
        supervisor = self.supervisor
        if metadata is not None and ACCESS_TOKEN in metadata:
            supervisor = self._known(metadata[ACCESS_TOKEN]).supervisor
        return AsyncRigHandle(supervisor.transport, self._rig)

    def log_in(self, name: str, key: str) -> str:
        """Return a token for a key of the supervisor; raises AuthenticationFailed."""
        now_s = time.monotonic()
        self._logins = {text: one for text, one in self._logins.items() if one.until_s > now_s}
        if len(self._logins) >= MOST_LOGINS:
            raise AuthenticationFailed(f"{MOST_LOGINS} clients are logged in, the maximum")
        try:
            supervisor = self._supervisor(key, name or None)
            session = self._background.call(supervisor.session())
        except (ClientError, CommandError, ValueError) as error:
            raise AuthenticationFailed(str(error)) from error
        if not session.keys:  # without keys, the supervisor would accept any password
            raise AuthenticationFailed("the supervisor has no keys; make one: pincette key add")
        if session.scope is None:
            raise AuthenticationFailed("the supervisor does not know this key")
        token = secrets.token_urlsafe(32)
        self._logins[token] = _Login(supervisor, now_s + LIFETIME_S)
        return token

    def log_out(self, token: str) -> bool:
        """Invalidate a token; return False if it is not known."""
        return self._logins.pop(token, None) is not None

    def check(self, token: str) -> None:
        """Raise InvalidAccessToken unless a token is known; this also extends its validity."""
        self._known(token).until_s = time.monotonic() + LIFETIME_S

    def _known(self, token: str) -> _Login:
        login = self._logins.get(token)
        if login is None or login.until_s < time.monotonic():
            raise InvalidAccessToken("log in again: this token is unknown or no longer valid")
        return login

    def _supervisor(self, key: str | None, name: str | None) -> AsyncSupervisor:
        return AsyncSupervisor(self._url, key=key, operator=name, authority=self._authority)


ACCESS_TOKEN = cast("Any", AuthorizationServiceFeature)["AccessToken"]


class Authentication(AuthenticationServiceBase):
    """Authentication by a key of the supervisor as password.

    The user name is recorded with each action.
    """

    def __init__(self, parent_server: SilaServer, callers: Callers) -> None:
        super().__init__(parent_server)
        self._callers = callers

    def Login(
        self,
        UserIdentification: str,
        Password: str,
        RequestedServer: str,
        RequestedFeatures: list[str],
        *,
        metadata: MetadataDict,
    ) -> Login_Responses:
        """Return a token for a key; the supervisor determines what the key permits."""
        try:
            meant = UUID(RequestedServer)
        except ValueError as error:
            raise AuthenticationFailed(f"{RequestedServer!r} is no server's UUID") from error
        there = {one.fully_qualified_identifier for one in self.parent_server.features.values()}
        if meant != self.parent_server.server_uuid or set(RequestedFeatures) - there:
            raise AuthenticationFailed("another server, or features that this server does not have")
        return Login_Responses(self._callers.log_in(UserIdentification, Password), LIFETIME_S)

    def Logout(self, AccessToken: str, *, metadata: MetadataDict) -> Logout_Responses:
        """Invalidate a token."""
        if not self._callers.log_out(AccessToken):
            raise UnknownToken("this token is not known")
        return Logout_Responses()


class Authorization(AuthorizationServiceBase):
    """Authorization of commands that move or cancel; never of an emergency stop."""

    def __init__(
        self, parent_server: SilaServer, callers: Callers, protected: list[Command]
    ) -> None:
        super().__init__(parent_server)
        self._protected = protected
        parent_server.add_metadata_interceptor(_TokenCheck(callers))

    def get_calls_affected_by_AccessToken(self) -> list[Command]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return the commands that need a token."""
        return self._protected


class _TokenCheck(MetadataInterceptor):
    def __init__(self, callers: Callers) -> None:
        super().__init__([ACCESS_TOKEN])  # pyright: ignore[reportUnknownMemberType]
        self._callers = callers

    def intercept(self, parameters: object, metadata: MetadataDict, target_call: str) -> None:
        self._callers.check(metadata[ACCESS_TOKEN])
