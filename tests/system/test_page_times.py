"""Times on the page, in the local time of the browser."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser, ViewportSize

from tests.support.browser import DESK, visit
from tests.support.rigs import demo_rig
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

CLOCK = """async (times) => {
  const words = await import('./page/js/words.js');
  return times.map(words.clock);
}"""
REPEATED = {
    "Europe/Berlin": ["2025-10-26T00:30:00.000Z", "2025-10-26T01:30:00.000Z"],
    "America/St_Johns": ["2025-11-02T04:00:00.000Z", "2025-11-02T05:00:00.000Z"],
}
"""Two times of a day on which clocks are set back, an hour apart and with the same local hour."""
SHOWN = {
    "Europe/Berlin": ["26 Oct 02:30:00 GMT+2", "26 Oct 02:30:00 GMT+1"],
    "America/St_Johns": ["2 Nov 01:30:00 GMT-2:30", "2 Nov 01:30:00 GMT-3:30"],
}
OTHER_DAY = "2025-10-25T00:30:00.000Z"


@pytest.mark.parametrize("zone", REPEATED)
def test_the_two_times_of_a_repeated_hour_differ(
    browser: Browser, tmp_path: Path, zone: str
) -> None:
    context = browser.new_context(viewport=ViewportSize(**DESK), timezone_id=zone)
    desk = Harness(demo_rig(time="lockstep"), tmp_path)
    with served(desk.app) as address:
        found = visit(context, address).page.evaluate(CLOCK, [*REPEATED[zone], OTHER_DAY])
        context.close()
    desk.close()
    assert found[:2] == SHOWN[zone]
    assert "GMT" not in found[2]
