"""The supervisor as the command line sees it."""

from typing import Any, cast

import httpx

DEFAULT_URL = "http://127.0.0.1:8000"


class CliError(Exception):
    """Something a person must do something about; the text says what."""


class Supervisor:
    """REST calls that return JSON or raise CliError with the problem's own words."""

    def __init__(self, url: str, timeout_s: float = 70.0) -> None:
        self._url = url.rstrip("/")
        try:
            self._client = httpx.Client(
                base_url=f"{self._url}/api/v1", timeout=timeout_s, trust_env=False
            )
        except httpx.InvalidURL as error:
            raise CliError(f"--url {url} is no address ({error}); one is {DEFAULT_URL}") from error

    def get(self, path: str, **query: str | float) -> Any:
        """Read a resource."""
        return self._call("GET", path, params=query)

    def post(self, path: str, body: Any = None, **query: str | float) -> Any:
        """Create a resource or ask for an action."""
        return self._call("POST", path, json=body, params=query)

    def _call(self, method: str, path: str, **details: Any) -> Any:
        try:
            response = self._client.request(method, path, **details)
        except (httpx.TransportError, httpx.InvalidURL) as error:
            raise CliError(
                f"no supervisor answers at {self._url} ({error}); start one with `pincette up`, "
                "or name another with --url"
            ) from error
        if response.is_error:
            raise CliError(problem_text(response))
        try:
            return response.json() if response.content else None
        except ValueError as error:
            raise CliError(
                f"what answers at {self._url} is no supervisor; name another with --url"
            ) from error


def problem_text(response: httpx.Response) -> str:
    """What an RFC 9457 answer says: its title, then each fault in a line, or its detail."""
    place = f"{response.request.method} {response.request.url}"
    try:
        problem = cast("dict[str, Any]", response.json())
        title = str(problem["title"])
    except (ValueError, TypeError, KeyError):
        return f"{place}: status {response.status_code}, and no words; is it a supervisor?"
    faults = [
        str(entry.get("message", entry)) if isinstance(entry, dict) else str(entry)
        for name in ("violations", "errors", "reasons")
        for entry in cast("list[dict[str, Any] | str]", problem.get(name, []))
    ]
    if not faults:
        return f"{title}: {problem.get('detail', '')}"
    return "\n".join([f"{title}:", *(f"  {fault}" for fault in faults)])
