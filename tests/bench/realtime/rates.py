"""Measure the punctuality of a loop at several rates: as four programs, as four bound to two
processors, and as one.

For an idle machine; without real-time priority unless requested. Adds to ``bench.json``; run by
``python -m tests.bench.realtime.rates``.
"""

import argparse
from dataclasses import asdict

from tests.bench.loop.report import keep
from tests.bench.realtime.measured import measured
from tests.bench.realtime.table import head, tell
from tests.support.rigs import Tree, laid_over

RATES_HZ = (50.0, 100.0, 200.0, 500.0, 1000.0)
SECONDS = 60.0
BOUND: Tree = {"sensor": [0], "actuator": [0], "estimator": [1], "controller": [1]}
"""Processors of the services: sensor and actuator share one, estimator and controller the other."""
FORMS: tuple[Tree, ...] = (
    {},
    {"realtime": {"cores": BOUND}},
    {"rig": {"composed": ["loop"]}},
)
SLOWEST_S = 0.0052
"""Two periods of the mode, in s; a faster loop estimates the force with a filter that models the
mode."""


def main() -> None:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.realtime.rates", description=__doc__
    )
    parser.add_argument("--hz", type=float, nargs="*", default=RATES_HZ)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="each; %(default)g")
    parser.add_argument("--priority", type=int, default=0, help="SCHED_FIFO; 0: none")
    given = parser.parse_args()
    head()
    found = [
        tell(measured(1, 0, given.seconds, _rig(1.0 / rate_hz, form, given.priority)))
        for rate_hz in given.hz
        for form in FORMS
    ]
    keep({}, {"rates": [asdict(one) for one in found]})


def _rig(period_s: float, form: Tree, priority: int) -> Tree:
    observer = {} if period_s > SLOWEST_S else {"force_observer": "kalman"}
    common: Tree = {
        "rig": {"period_s": period_s},
        "model": observer,
        "realtime": {"priority": priority, "computing_s": min(0.002, 0.4 * period_s)},
    }
    return laid_over(common, form)


if __name__ == "__main__":
    main()
