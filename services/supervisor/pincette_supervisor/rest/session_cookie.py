"""The cookie of a signed-in page.

Cookies ignore ports, so the name contains the supervisor's identifier: a browser that is signed in
to two supervisors of one host stays signed in to both. Over TLS the name has the prefix
``__Host-``. A page over plain HTTP cannot replace a secure cookie of the same name.
"""

from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import Scope

NAME = "pincette_session"
SECURE = "__Host-"


def cookie_name(supervisor: str) -> str:
    """Return the name of the cookie over plain HTTP."""
    return f"{NAME}_{supervisor}" if supervisor else NAME


def session_cookies(scope: Scope, supervisor: str) -> list[str]:
    """Return the values of the cookies of one supervisor that a request sent."""
    cookies, name = HTTPConnection(scope).cookies, cookie_name(supervisor)
    return [cookies[one] for one in (SECURE + name, name) if one in cookies]


def set_cookie(response: Response, scope: Scope, supervisor: str, value: str) -> None:
    """Sign a page in: no script reads the cookie, and no page of another site has it sent."""
    secure = _is_secure(HTTPConnection(scope))
    name = (SECURE if secure else "") + cookie_name(supervisor)
    response.set_cookie(name, value, path="/", httponly=True, samesite="strict", secure=secure)


def _is_secure(connection: HTTPConnection) -> bool:
    """Whether the page, or another client, is connected over TLS, which may end at a proxy."""
    # Every browser states the address of its page; a program does not, but the proxy may state how
    # it was reached. A client that invents either harms only its own cookie.
    forwarded = connection.headers.get("x-forwarded-proto", "").partition(",")[0].strip()
    page = connection.headers.get("origin") or forwarded or str(connection.url.scheme)
    return page.lower().startswith("https")


def delete_cookies(response: Response, scope: Scope, supervisor: str) -> None:
    """Sign a page out: delete the cookies that it sent."""
    cookies, name = HTTPConnection(scope).cookies, cookie_name(supervisor)
    for one, secure in ((SECURE + name, True), (name, False)):
        if one in cookies:
            response.delete_cookie(one, path="/", httponly=True, samesite="strict", secure=secure)
