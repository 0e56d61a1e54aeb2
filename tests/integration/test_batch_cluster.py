"""A batch on a cluster: a real Dask scheduler and two worker processes, by its executor."""

from collections.abc import Generator
from concurrent.futures import Executor
from functools import partial

import pytest

from pincette.config import ConfigError
from pincette.config.gains import tuned
from pincette_batch.cases import Case, Run
from pincette_batch.runs import play_all
from pincette_batch.tuning import tracks_on
from tests.support.batches import drawn_rig, same, short_grip
from tests.support.rigs import demo_rig

distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")

WORKERS = 2


@pytest.fixture(scope="module")
def cluster() -> Generator[Executor]:
    with (
        distributed.LocalCluster(
            n_workers=WORKERS, threads_per_worker=1, processes=True, dashboard_address=None
        ) as local,
        distributed.Client(local) as client,
    ):
        client.wait_for_workers(WORKERS)
        yield client.get_executor()


def cases() -> list[Case]:
    rig = drawn_rig(3)
    return [Case(rig, short_grip(rig), seed) for seed in range(4)]


def test_a_cluster_gives_the_same_bits_and_tells_its_progress(cluster: Executor) -> None:
    told: list[tuple[int, int]] = []
    here = play_all(cases())

    def tell(done: int, all_: int) -> None:
        told.append((done, all_))

    there: list[Run] = play_all(cases(), workers=WORKERS, executor=cluster, progress=tell)
    for one, other in zip(here, there, strict=True):
        same(one, other)
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_the_search_for_gains_is_the_same_on_a_cluster(cluster: Executor) -> None:
    search = partial(tuned, demo_rig(), "dsmifc")
    assert search(tracks=tracks_on(WORKERS, executor=cluster)) == search(tracks=tracks_on(1))


def test_an_error_on_the_cluster_is_raised_here(cluster: Executor) -> None:
    real = cases()[0].rig.model_copy(update={"simulation": None})
    with pytest.raises(ConfigError, match=r"needs .* a \[simulation\]"):
        play_all([Case(real, cases()[0].program)], executor=cluster)
