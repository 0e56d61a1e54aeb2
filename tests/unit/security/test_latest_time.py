"""A time that never goes back, and a certificate that expired before the clock was set back."""

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from pincette.bus.protocol import BusError
from pincette.bus.vouching import Vouching
from pincette.security.latest_time import LatestTime
from tests.support.certificates import folder_for

HOUR = timedelta(hours=1)


class Clocks:
    """A time of day that a test sets, and the elapsed time."""

    def __init__(self) -> None:
        self.wall, self.passed_s = datetime.now(UTC), 0.0

    def time(self) -> LatestTime:
        return LatestTime(lambda: self.wall, lambda: self.passed_s)

    def go_on(self, duration: timedelta) -> None:
        self.wall += duration
        self.passed_s += duration.total_seconds()


@pytest.fixture
def clocks() -> Clocks:
    return Clocks()


def test_the_latest_time_advances_by_elapsed_time_while_the_clock_is_behind(clocks: Clocks) -> None:
    time, begin = clocks.time(), clocks.wall
    clocks.wall -= 1000 * HOUR
    clocks.go_on(HOUR)
    assert (time.now(), time.ahead) == (begin + HOUR, 1000 * HOUR)
    clocks.go_on(HOUR)
    assert time.now() == begin + 2 * HOUR


def test_the_latest_time_follows_a_step_forward_but_not_backward(clocks: Clocks) -> None:
    time, begin = clocks.time(), clocks.wall
    clocks.wall += 1000 * HOUR
    assert (time.now(), time.ahead) == (begin + 1000 * HOUR, timedelta(0))
    clocks.wall -= 1000 * HOUR
    assert (time.now(), time.ahead) == (begin + 1000 * HOUR, 1000 * HOUR)


def test_a_person_confirms_the_time_of_day(clocks: Clocks) -> None:
    time = clocks.time()
    clocks.wall -= 1000 * HOUR
    assert time.now() > clocks.wall
    time.agree()
    assert (time.now(), time.ahead) == (clocks.wall, timedelta(0))


@pytest.mark.parametrize("year", [2200, 9999])
def test_the_latest_time_includes_that_of_an_earlier_program(clocks: Clocks, year: int) -> None:
    time = clocks.time()
    time.learn(datetime(2000, 1, 1, tzinfo=UTC))
    assert time.now() == clocks.wall
    time.learn(datetime(year, 6, 30, tzinfo=UTC))
    clocks.go_on(10 * HOUR)
    assert time.now().year == min(year, 9000)
    assert time.ahead > HOUR


def test_an_expired_certificate_opens_no_link_after_a_step_back(
    tmp_path: Path, clocks: Clocks
) -> None:
    folder, time = folder_for(tmp_path / "pki", "demo"), clocks.time()
    vouching = Vouching(folder.credentials(folder.named("viewer")), time)
    end = clocks.wall + 24 * HOUR
    shown: Any = {
        "notAfter": end.strftime("%b %d %H:%M:%S %Y GMT"),
        "serialNumber": "0A",
        "subject": ((("commonName", "viewer"),),),
    }
    assert vouching.inner(shown) is vouching.inner(shown)
    clocks.go_on(25 * HOUR)
    for back in (0, 2, 1000):
        clocks.wall -= back * HOUR
        with pytest.raises(BusError, match="expired"):
            vouching.inner(shown)
