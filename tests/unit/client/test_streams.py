"""Events without gap or duplicate over lines that break, and complete downloads of files."""

import asyncio
import hashlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest

from pincette.api.events import Event
from pincette.api.jobs import Artifact
from pincette.api.live import LiveBatch
from pincette.client import DamagedFileError, ForeignAnswerError, NoAnswerError, ProblemError

from . import desk
from .desk import Desk


def event(number: int | None, **changes: Any) -> dict[str, Any]:
    kind = "progress" if number is None else "state"
    return desk.example(Event, number=number, kind=kind, **changes)


def answers() -> Desk:
    """Return a stream that breaks, a supervisor that restarts, a replay with duplicates, and an
    end."""
    return Desk(
        desk.job(),
        desk.stream(event(7), event(None), event(8), broken=True),
        httpx.ConnectError("refused"),
        desk.stream(event(8), event(9)),
        desk.job(state="running"),
        desk.stream(event(10)),
        desk.job(state="succeeded"),
    )


def test_a_stream_continues_where_it_broke() -> None:
    supervisor = answers()
    job = supervisor.supervisor().job("j")
    assert [item.number for item in job.events()] == [7, None, 8, 9, 10]
    streams = [one for one in supervisor.asked if one.url.path.endswith("/events")]
    assert [one.headers["Last-Event-ID"] for one in streams] == ["0", "8", "8", "9"]
    assert job.state == "succeeded"


def test_a_finished_job_has_no_more_events() -> None:
    over = desk.job(state="succeeded")
    supervisor = Desk(desk.job(), desk.stream(event(7), broken=True), httpx.Response(204), over)
    assert [item.number for item in supervisor.supervisor().job("j").events()] == [7]


def test_the_asynchronous_client_reads_the_same_stream() -> None:
    supervisor = answers()

    async def run() -> list[int | None]:
        job = await supervisor.async_supervisor().job("j")
        return [item.number async for item in job.events()]

    assert asyncio.run(run()) == [7, None, 8, 9, 10]


def test_events_of_a_rig_start_at_the_newest_even_if_the_connection_breaks_at_once() -> None:
    newest = httpx.Response(200, json={"events": [], "newest": 41, "oldest": 1})
    lost = httpx.ReadTimeout("silent")
    supervisor = Desk(newest, desk.stream(broken=True), lost, desk.stream(event(42)))
    events = supervisor.supervisor().rig("demo").events()
    assert next(events).number == 42
    ids = [one.headers.get("Last-Event-ID") for one in supervisor.asked]
    assert ids == [None, "41", "41", "41"]


def test_a_stream_that_does_not_return_is_an_error() -> None:
    supervisor = Desk(desk.job(), *[httpx.ConnectError("refused")] * 20)
    job = supervisor.supervisor(patience_s=3.0).job("j")
    with pytest.raises(NoAnswerError, match="/events: no answer"):
        next(job.events())
    assert supervisor.now_s <= 3.0


def test_an_invalid_stream_is_reported() -> None:
    supervisor = Desk(desk.job(), httpx.Response(200, json={}), desk.problem(503, "too-many"))
    job = supervisor.supervisor().job("j")
    with pytest.raises(ForeignAnswerError, match="application/json, no events"):
        next(job.events())
    with pytest.raises(ProblemError) as refused:
        next(job.events())
    assert refused.value.code == "too-many"


def batch(epoch: int, *seqs: int, now_s: float = 100.0, **changes: Any) -> dict[str, Any]:
    """Return a batch of samples at 20 ms, the last of which was taken at ``now_s``."""
    many = len(seqs)
    columns = ("x_um", "x_r_um", "force_mN", "force_r_mN", "voltage_V", "sliding_um")
    values: dict[str, Any] = {name: [float(seq) for seq in seqs] for name in columns}
    values["force_uncertainty_mN"] = [0.4] * many
    values["at_s"] = [now_s - 0.02 * (seqs[-1] - seq) for seq in seqs] if seqs else []
    values["t_s"] = [0.02 * seq for seq in seqs]
    data = desk.example(
        LiveBatch, epoch=epoch, seq=list(seqs), now_s=now_s, **{**values, **changes}
    )
    return {"kind": "live", "number": None, **data}


def test_each_sample_arrives_once_although_the_connection_breaks() -> None:
    supervisor = Desk(
        desk.stream(batch(7, 5, 6), batch(7), batch(7, 7, force_mN=[None]), broken=True),
        httpx.ConnectError("refused"),
        desk.stream(batch(7, 5, 6, 7, 8, now_s=101.0), batch(9, 0, 1, now_s=102.0)),
    )
    live = supervisor.supervisor().rig("demo").live()
    found = [next(live) for _ in range(6)]
    assert [(one.epoch, one.seq) for one in found] == [
        (7, 5),
        (7, 6),
        (7, 7),
        (7, 8),
        (9, 0),
        (9, 1),
    ]
    assert found[0].x_um == 5.0
    assert (found[0].playing, found[0].phase) == (True, "hold")
    assert found[2].force_mN is None


@pytest.mark.parametrize(("past_s", "first"), [(0.0, 475), (5.0, 225), (60.0, 0)])
def test_the_last_minute_is_sent_on_request(past_s: float, first: int) -> None:
    supervisor = Desk(desk.stream(batch(7, *range(501))))
    assert next(supervisor.supervisor().rig("demo").live(past_s)).seq == first


CONTENT = b"t_s,x_um\n0.0,1.0\n"


def listed(sha256: str) -> httpx.Response:
    file = desk.example(Artifact, name="samples.csv", sha256=sha256)
    return httpx.Response(200, json={"artifacts": [file]})


def test_a_file_arrives_completely(tmp_path: Path) -> None:
    whole = listed(hashlib.sha256(CONTENT).hexdigest())
    broken = desk.stream(broken=True)
    supervisor = Desk(desk.job(), whole, broken, httpx.Response(200, content=CONTENT))
    path = supervisor.supervisor().job("j").download("samples.csv", tmp_path / "out")
    assert path == tmp_path / "out" / "samples.csv"
    assert path.read_bytes() == CONTENT
    assert [one.name for one in path.parent.iterdir()] == ["samples.csv"]


def test_a_damaged_file_is_deleted(tmp_path: Path) -> None:
    supervisor = Desk(desk.job(), listed("0" * 64), httpx.Response(200, content=CONTENT))
    with pytest.raises(DamagedFileError, match="the record states 0000"):
        supervisor.supervisor().job("j").download("samples.csv", tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["../samples.csv", "/etc/hosts"])
def test_a_name_with_a_folder_in_it_is_refused(tmp_path: Path, name: str) -> None:
    supervisor = Desk(desk.job(), listed("0" * 64))
    with pytest.raises(ValueError, match="is not a file name"):
        supervisor.supervisor().job("j").download(name, tmp_path)


def test_the_blocking_client_works_if_an_event_loop_runs_already() -> None:
    events = [desk.example(Event, number=1), desk.example(Event, number=2)]
    supervisor = Desk(desk.job(), desk.stream(*events), desk.job(state="succeeded"))

    async def notebook() -> list[int | None]:
        job = supervisor.supervisor().job("j")
        return [event.number for event in job.events()]

    assert asyncio.run(notebook()) == [1, 2]


def test_the_blocking_client_works_in_threads() -> None:
    supervisor = Desk(*[desk.rig()] * 20)
    rig = supervisor.supervisor().rig("demo")
    with ThreadPoolExecutor(4) as threads:
        found = [threads.submit(rig.state) for _ in range(20)]
    assert [one.result().name for one in found] == ["demo"] * 20


def test_leaving_a_stream_releases_its_connection() -> None:
    events = [desk.example(Event, number=1), desk.example(Event, number=2)]
    response = desk.stream(*events)
    supervisor = Desk(desk.job(), response)
    for event in supervisor.supervisor().job("j").events():
        assert event.number == 1
        break
    assert response.is_closed
