"""Tools over streamable HTTP with the Python and TypeScript SDKs, and the key of the server."""

import asyncio
import os
import stat
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import httpx2
import pytest
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

from contrib.support.agent import planned, refused, said
from contrib.support.npm import node, npm_folder
from pincette_mcp.plans import NoPlanError, Tokens
from tests.support.adapters import FORCE_MN, NEAR_MN, WAIT_S, until
from tests.support.checkout import ROOT
from tests.support.rigs import free_ports
from tests.support.running import RunningRig

DRIVE = ROOT / "contrib/support/mcp_http.mjs"
SDK = "@modelcontextprotocol/sdk@1.32.2"
LOOKS = ["plan_grip", "plan_series", "series", "status"]
MOVES = ["decide", "grip", "release", "run_series"]
TOOLS = sorted([*LOOKS, *MOVES, "emergency_stop", "stop"])


@contextmanager
def served(rig: RunningRig, settings: Path, **environment: str) -> Generator[str]:
    """Address of an HTTP server whose account has a separate settings folder."""
    port = free_ports(1)
    url = f"http://127.0.0.1:{port}/mcp"
    words = ["--url", rig.rig.supervisor.url, "--move", "--http", "--port", str(port)]
    process = subprocess.Popen(
        [sys.executable, "-m", "pincette_mcp", *words],
        env={**os.environ, "XDG_CONFIG_HOME": str(settings), **environment},
    )
    try:
        until(lambda: answered(url) == 401, "the server does not require a key")
        yield url
    finally:
        process.terminate()
        process.wait(WAIT_S)


def answered(url: str, key: str = "") -> int | None:
    """Status of a request with a key; None without an answer."""
    try:
        given = {"Authorization": f"Bearer {key}"} if key else {}
        return httpx.post(url, json={}, headers=given, trust_env=False).status_code
    except httpx.TransportError:
        return None


async def by_python(url: str, key: str) -> dict[str, Any]:
    """Grip and release with the Python SDK."""
    http = httpx2.AsyncClient(headers={"Authorization": f"Bearer {key}"}, timeout=WAIT_S)
    async with (
        asyncio.timeout(WAIT_S),
        http,
        Client(streamable_http_client(url, http_client=http)) as client,
    ):
        assert sorted(tool.name for tool in (await client.list_tools()).tools) == TOOLS
        token = await planned(client)
        held = await said(client, "grip", token=token)
        assert "was already used" in await refused(client, "grip", token=token)
        assert (await said(client, "release"))["part"] == "none"
        return held


def test_the_python_sdk_grips_and_releases(rig: RunningRig, tmp_path: Path) -> None:
    with served(rig, tmp_path) as url:
        path = tmp_path / "pincette/mcp-key"
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert answered(url, "another key") == 401
        held = asyncio.run(by_python(url, path.read_text()))
    assert held["outcome"] == "held"
    assert abs(held["force_held_mN"] - FORCE_MN) < NEAR_MN


def test_the_typescript_sdk_plans_and_grips_in_one_session(rig: RunningRig, tmp_path: Path) -> None:
    folder = npm_folder(tmp_path / "node", DRIVE, SDK)
    with served(rig, tmp_path, PINCETTE_MCP_KEY="a key") as url:
        found = node(folder, DRIVE.name, url, "a key", str(FORCE_MN))
    assert not (tmp_path / "pincette/mcp-key").exists()
    assert found["tools"] == TOOLS
    is_error, words = found["refused"]
    assert is_error
    assert "no-plan: this token belongs to another session" in words
    assert abs(found["held"]["force_held_mN"] - FORCE_MN) < NEAR_MN
    assert found["part"] == "none"
    assert "requires its key" in found["without"]


def test_a_token_is_valid_in_its_session_only() -> None:
    tokens = Tokens(b"secret", lambda: 0.0)
    token = tokens.of("demo", FORCE_MN, None, "one")
    for other in ("", "another"):
        with pytest.raises(NoPlanError, match="another session"):
            tokens.take(token, other)
    assert tokens.take(token, "one").force_mN == FORCE_MN
