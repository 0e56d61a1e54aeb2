"""Dry runs that wait for a prediction leave other requests their threads."""

import threading
from concurrent.futures import ThreadPoolExecutor

import httpx

from pincette_supervisor.planning.dry_run import DryRun
from pincette_supervisor.planning.prediction import PredictionCache, played
from pincette_supervisor.plugin import Planned
from pincette_supervisor.rest.server import WORKERS
from tests.support.served import served

from .harness import Harness

PATIENCE_S = 60.0


def test_requests_for_lists_and_jobs_are_answered_during_long_predictions(harness: Harness) -> None:
    begun, over = threading.Event(), threading.Event()

    def play(planned: Planned) -> DryRun:
        begun.set()
        assert over.wait(PATIENCE_S)
        return played(planned)

    harness.manager.predictions = PredictionCache(play)
    body = {"kind": "grip", "dry_run": True}

    def dry_run(number: int) -> int:
        with httpx.Client(trust_env=False, timeout=2.0 * PATIENCE_S) as client:
            wish = {**body, "force_mN": 8.0 + number}
            return client.post(f"{url}/api/v1/jobs", json=wish).status_code

    count = 2 * WORKERS
    with served(harness.app) as url, ThreadPoolExecutor(count) as threads:
        runs = [threads.submit(dry_run, number) for number in range(count)]
        try:
            assert begun.wait(PATIENCE_S)
            with httpx.Client(trust_env=False, timeout=PATIENCE_S) as client:
                for _ in range(3):
                    assert client.get(f"{url}/api/v1/jobs").json()["jobs"] == []
                job = client.post(
                    f"{url}/api/v1/jobs?predict=false", json={"kind": "grip", "autostart": True}
                )
                assert job.status_code == 201, job.text
                harness.manager.perform(job.json()["id"], "stop", "test")
        finally:
            over.set()
        assert [one.result() for one in runs] == [200] * count
