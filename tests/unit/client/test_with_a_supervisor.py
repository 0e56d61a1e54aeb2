"""Both clients with the supervisor itself, in one process."""

import asyncio
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from pincette.client import AsyncSupervisor, ProblemError, Supervisor
from pincette.config import parse_rig
from pincette_supervisor.kinds.grip import GripResult
from tests.unit.supervisor.harness import Harness

DEMO = Path(__file__).parents[3] / "deploy" / "rigs" / "demo.toml"
URL = "http://localhost"


class InProcess(httpx.BaseTransport):
    """Calls the application without a network."""

    def __init__(self, app: Any) -> None:
        self._app = app

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        async def send() -> httpx.Response:
            answer = await httpx.ASGITransport(self._app).handle_async_request(request)
            content = await answer.aread()
            return httpx.Response(answer.status_code, headers=answer.headers, content=content)

        return asyncio.run(send())


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Harness]:
    tables: dict[str, Any] = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    tables["rig"]["time"] = "lockstep"
    made = Harness(parse_rig(tables), tmp_path / "data")
    yield made
    made.close()


def test_a_grip_runs_from_the_feasibility_check_to_its_record(
    bench: Harness, tmp_path: Path
) -> None:
    with Supervisor(URL, transport=InProcess(bench.app), operator="cell 7") as supervisor:
        rig = supervisor.rig()
        assert rig.can_start() == []
        job = rig.start("grip", idempotency_key="part-1", labels={"part": "1"})
        assert rig.start("grip", idempotency_key="part-1", labels={"part": "1"}).id == job.id
        assert job.wait(30.0).state == "succeeded"
        result = job.result()
        assert isinstance(result, GripResult)
        assert result.outcome == "gripped"
        events = list(job.events())
        numbers = [event.number for event in events if event.number is not None]
        assert numbers == sorted(set(numbers))
        states = [event.body["state"] for event in events if event.kind == "state"]
        assert states[-2:] == ["running", "succeeded"]
        assert list(job.events(after=numbers[-1])) == []
        path = job.download("result.json", tmp_path / "here")
        assert path.read_bytes().startswith(b"{")
        assert [one.id for one in rig.jobs(label="part=1")] == [job.id]


def test_a_key_that_is_used_for_another_request_is_refused(bench: Harness) -> None:
    with Supervisor(URL, transport=InProcess(bench.app)) as supervisor:
        rig = supervisor.rig()
        rig.start("grip", idempotency_key="part-1").wait(30.0)
        with pytest.raises(ProblemError) as refused:
            rig.start("grip", idempotency_key="part-1", force_mN=11.0)
        assert refused.value.code == "idempotency-key-reused"
        with pytest.raises(ProblemError) as refused:
            rig.start("grip", force_mN=500.0)
        assert refused.value.code == "limit-violation"
        assert refused.value.violations[0]["limit"] == 40.0


def test_a_held_part_is_released_by_the_asynchronous_client(bench: Harness) -> None:
    bench.bus.pause_at = 190

    async def run() -> list[str]:
        transport = httpx.ASGITransport(bench.app)
        async with AsyncSupervisor(URL, transport=transport) as supervisor:
            rig = await supervisor.rig()
            job = await rig.start("grip", until_released=True)
            while "release" not in job.job.allowed_actions:
                await job.refresh(0.1)
            await job.release()
            await job.wait(30.0)
            return [job.state, str((job.job.result or {})["outcome"])]

    assert asyncio.run(run()) == ["succeeded", "released"]
