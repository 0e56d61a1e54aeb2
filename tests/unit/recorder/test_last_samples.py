"""Topics have separate channels, and the last sample of none is cut off."""

import pytest

from pincette.core.messages import Applied, Command, Estimate, Position, Recorded, Telemetry
from tests.support.recorded import loop

from .conftest import Bench


@pytest.mark.parametrize("late", [Position, Estimate, Command, Telemetry, Applied])
def test_the_end_of_a_record_waits_for_a_late_topic(bench: Bench, late: type) -> None:
    messages = loop(10)
    bench.begin()
    bench.feed([item for item in messages if not isinstance(item, late)])
    assert bench.finish(9) is None
    bench.feed([item for item in messages if isinstance(item, late)])
    bench.wait(0.1)
    recorded = bench.reply
    assert isinstance(recorded, Recorded)
    assert recorded.complete


def test_a_record_of_an_ended_arming_is_complete_without_a_stated_last_sample(bench: Bench) -> None:
    bench.begin()
    bench.feed(loop(10))
    recorded = bench.finish(None)
    assert isinstance(recorded, Recorded)
    assert recorded.complete


@pytest.mark.parametrize("ticks", [0, 10])
def test_an_unknown_last_sample_is_awaited_until_nothing_arrives(bench: Bench, ticks: int) -> None:
    bench.begin()
    stated = loop(ticks)
    messages = [item for item in stated if not (isinstance(item, Applied) and item.final)]
    bench.feed(messages[:20])
    assert bench.finish(None) is None
    bench.wait(0.2)
    assert bench.reply is None
    bench.feed(messages[20:])
    bench.wait(0.1)
    assert bench.reply is None
    bench.wait(0.4)
    recorded = bench.reply
    assert isinstance(recorded, Recorded)
    assert (recorded.complete, recorded.messages) == (True, len(messages))
