"""The catalogue of the installed plug-ins, over REST."""

from typing import Any

import pytest

from pincette_supervisor.rest import routes_jobs

from .harness import Harness


def test_descriptions_of_job_kinds_are_computed_once(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    described: list[str] = []
    describe = routes_jobs.described

    def counted(kind: Any) -> Any:
        described.append(kind.name)
        return describe(kind)

    routes_jobs._installed_kinds.cache_clear()  # pyright: ignore[reportPrivateUsage]
    monkeypatch.setattr(routes_jobs, "described", counted)
    first, second = harness.get("/kinds"), harness.get("/kinds")
    assert first == second
    assert described == [kind["name"] for kind in first["kinds"]]
