"""Stock client of the Model Context Protocol over stdio, and calls of a rig's tools with it."""

import asyncio
import os
import sys
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

from mcp import Client, StdioServerParameters

from tests.support.adapters import FORCE_MN, WAIT_S


@asynccontextmanager
async def agent(url: str, *options: str, key: str = "") -> AsyncGenerator[Client]:
    """Provide the stock client, with a server of this project for the supervisor at ``url``."""
    async with asyncio.timeout(WAIT_S), Client(server_of(url, *options, key=key)) as client:
        yield client


def server_of(url: str, *options: str, key: str = "") -> StdioServerParameters:
    """Return the parameters of the server.

    They pass on the settings folder, which the SDK hides from the server by default.
    """
    words = ["-m", "pincette_mcp", "--url", url, *options]
    environment = {**os.environ, "PINCETTE_KEY": key}
    return StdioServerParameters(command=sys.executable, args=words, env=environment)


async def said(client: Client, tool: str, **arguments: Any) -> dict[str, Any]:
    """Return the answer of a tool."""
    answer = await client.call_tool(tool, arguments)
    assert not answer.is_error, answer.content
    assert answer.structured_content is not None
    return answer.structured_content


async def refused(client: Client, tool: str, **arguments: Any) -> str:
    """Return the error text of a tool that fails."""
    answer = await client.call_tool(tool, arguments)
    assert answer.is_error, answer.structured_content
    return getattr(answer.content[0], "text", "")


async def planned(client: Client, **arguments: Any) -> str:
    """Return the token of a feasible plan."""
    plan = await said(client, "plan_grip", force_mN=FORCE_MN, **arguments)
    assert (plan["feasible"], plan["violations"]) == (True, [])
    return plan["token"]
