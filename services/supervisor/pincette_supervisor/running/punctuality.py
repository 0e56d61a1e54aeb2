"""How punctual the programs of a loop are, as each says of itself."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import cast

from pincette.api.timing_models import LoopTiming
from pincette.bus.protocol import Bus, BusError
from pincette.messages import Timing, TimingRequest
from pincette.records.timings import program_timing
from pincette.topics import LOOP, TIMING_OF

ASK_S = 0.7


def punctuality(bus: Bus) -> LoopTiming:
    """Ask all of them side by side; in lockstep each says that nothing is late."""
    with ThreadPoolExecutor(len(LOOP), thread_name_prefix="timing") as pool:
        answers = dict(zip(LOOP, pool.map(partial(_asked, bus), LOOP), strict=True))
    return LoopTiming(
        programs=[program_timing(one) for one in answers.values() if isinstance(one, Timing)],
        silent={name: why for name, why in answers.items() if isinstance(why, str)},
    )


def _asked(bus: Bus, name: str) -> Timing | str:
    try:
        return cast(Timing, bus.ask(TIMING_OF[name], TimingRequest(), ASK_S))
    except BusError as error:
        return str(error)
