"""The simulated instruments of some rigs in one process, which reply as fast as they can.

python -m tests.bench.realtime.instruments RIG_FILE ...

Unlike in the program ``rig``, neither line nor instrument has a delay; the plants are the same.
Ends when standard input closes.
"""

import subprocess
import sys
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from time import monotonic

from pincette.config import read_rig
from pincette.sim.bench import open_bench
from pincette.sim.instruments.protocol import Instrument
from pincette.sim.wires.wire import serve

READY = b"ready\n"


class Unhurried:
    """An instrument that replies without delay."""

    def __init__(self, instrument: Instrument) -> None:
        self.answer, self.idle = instrument.answer, instrument.idle


def main(paths: Sequence[str]) -> None:
    """Serve the instruments."""
    with ExitStack() as stack:
        for path in paths:
            rig = read_rig(Path(path))
            simulated = open_bench(rig, monotonic)
            stack.enter_context(serve(rig.sensor.url, Unhurried(simulated.sensor)))
            stack.enter_context(serve(rig.output.url, Unhurried(simulated.output)))
        sys.stdout.buffer.write(READY)
        sys.stdout.buffer.flush()
        sys.stdin.read()


@contextmanager
def instruments(paths: Sequence[Path]) -> Generator[int]:
    """Start the process of the instruments; yields its number."""
    command = [sys.executable, "-m", __name__, *map(str, paths)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            if process.stdout.readline() != READY:
                raise RuntimeError("the simulated instruments did not start")
            yield process.pid
        finally:
            process.communicate(timeout=10.0)


if __name__ == "__main__":
    main(sys.argv[1:])
