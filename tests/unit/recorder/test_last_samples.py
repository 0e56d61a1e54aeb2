"""Each topic has a way of its own, and the last sample of none is cut off."""

import pytest

from pincette.core.messages import Applied, Command, Estimate, Position, Recorded, Telemetry
from tests.support.recorded import loop

from .conftest import Bench


@pytest.mark.parametrize("late", [Position, Estimate, Command, Telemetry, Applied])
def test_a_topic_that_lags_behind_the_others_is_waited_for(bench: Bench, late: type) -> None:
    messages = loop(10)
    bench.begin()
    bench.feed([item for item in messages if not isinstance(item, late)])
    assert bench.finish(9) is None
    bench.feed([item for item in messages if isinstance(item, late)])
    bench.wait(0.1)
    recorded = bench.reply
    assert isinstance(recorded, Recorded)
    assert recorded.complete
