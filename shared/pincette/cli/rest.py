"""The supervisor as the command line sees it."""

from typing import Any, cast

import httpx

DEFAULT_URL = "http://127.0.0.1:8000"


class CliError(Exception):
    """Something a person must do something about; the text says what."""


class Supervisor:
    """REST calls that return JSON or raise CliError with the problem's own words."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._client = httpx.Client(base_url=f"{url}/api/v1", timeout=70.0, trust_env=False)

    def get(self, path: str, **query: str | float) -> Any:
        """Read a resource."""
        return self._call("GET", path, params=query)

    def post(self, path: str, body: Any = None, **query: str | float) -> Any:
        """Create a resource or ask for an action."""
        return self._call("POST", path, json=body, params=query)

    def _call(self, method: str, path: str, **details: Any) -> Any:
        try:
            response = self._client.request(method, path, **details)
        except httpx.TransportError as error:
            raise CliError(
                f"no supervisor answers at {self._url} ({error}); start one with `pincette up`, "
                "or name another with --url"
            ) from error
        if response.is_error:
            raise CliError(problem_text(response))
        return response.json() if response.content else None


def problem_text(response: httpx.Response) -> str:
    """What an RFC 9457 answer says, in lines."""
    try:
        problem = cast("dict[str, Any]", response.json())
    except ValueError:
        return f"{response.request.method} {response.request.url}: {response.status_code}"
    lines = [f"{problem.get('title', response.status_code)}: {problem.get('detail', '')}"]
    for name in ("violations", "errors"):
        for entry in problem.get(name, []):
            lines.append(f"  {entry.get('pointer', '')} {entry.get('message', entry)}")
    lines += [f"  {reason}" for reason in problem.get("reasons", [])]
    return "\n".join(lines)
