"""A router that does not reply to itself ends; one that replies, or that was not scheduled,
continues."""

import pytest

from pincette.cli import Exit
from pincette.engine.router_watch import ENDED_STATUS, LOOK_S, RouterWatch

LIMIT_S = 5.0


class Router:
    """A router that replies or raises an error, its clock, and the number of requested ends."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.error: Exception | None = None
        self.ends: list[float] = []
        self.watch = RouterWatch(self.ask, LIMIT_S, self.ends.append, lambda: self.now_s)

    def ask(self) -> None:
        if self.error is not None:
            raise self.error

    def look_for(self, duration_s: float) -> None:
        for _ in range(round(duration_s / LOOK_S)):
            self.now_s += LOOK_S
            self.watch.look()


@pytest.fixture
def router() -> Router:
    return Router()


def test_a_router_that_replies_to_its_queries_continues(router: Router) -> None:
    for _ in range(50):
        router.watch.ask()
        router.look_for(LIMIT_S)
    assert router.ends == []


def test_a_query_that_does_not_return_ends_the_router_after_the_limit(router: Router) -> None:
    router.watch.ask()
    router.look_for(LIMIT_S)
    assert router.ends == []
    router.look_for(LOOK_S)
    assert router.ends == [pytest.approx(LIMIT_S + LOOK_S)]


def test_a_router_whose_queries_fail_is_ended(router: Router) -> None:
    router.error = RuntimeError("the session is closed")
    for _ in range(round(LIMIT_S / LOOK_S) + 1):
        with pytest.raises(RuntimeError):
            router.watch.ask()
        router.look_for(LOOK_S)
    assert len(router.ends) == 1


@pytest.mark.parametrize("paused_s", [LIMIT_S + 1.0, 3600.0])
def test_a_suspended_router_gets_time_to_answer_its_own_query(
    router: Router, paused_s: float
) -> None:
    for _ in range(3):
        router.now_s += paused_s
        router.watch.look()
        assert router.ends == []
        router.watch.ask()


def test_the_exit_status_is_that_of_the_documented_list() -> None:
    assert Exit.ROUTER_LOCKED == ENDED_STATUS
    assert [status for status in Exit if status == ENDED_STATUS] == [Exit.ROUTER_LOCKED]
