"""Stalls as containers see them, recorded by one with the CPU weight of a program of the loop.

In containers the loop has no real-time priority, so a busy machine delays it; a recorder with
real-time priority would not notice this.
"""

import subprocess
import threading

from tests.support.engine import docker
from tests.support.stalls import STALL_S, StallRecorder

IMAGE, NAME = "pincette-loop", "pincette-stalls"
WEIGHT = "8192"
"""CPU weight that the compose file gives the loop."""
BEAT_S = 0.002
"""Interval of the checks, long enough that the loop loses no noticeable time."""
READY = "ready"
READY_S = 30.0
BEAT = f"""\
import os, threading, time
def beat(processor):
    os.sched_setaffinity(0, {{processor}})
    last = time.monotonic()
    while True:
        time.sleep({BEAT_S})
        now = time.monotonic()
        if now - last - {BEAT_S} > {STALL_S}:
            os.write(1, f"{{last}} {{now - last - {BEAT_S}}}\\n".encode())
        last = now
for processor in os.sched_getaffinity(0):
    threading.Thread(target=beat, args=(processor,)).start()
print({READY!r}, flush=True)
"""


class ContainerStalls(StallRecorder):
    """Stalls of a container that does nothing else; needs the image of the loop."""

    def __enter__(self) -> "ContainerStalls":
        docker("rm", "--force", NAME)
        words = ["--rm", "--name", NAME, "--network", "none", "--cpu-shares", WEIGHT]
        self._process = subprocess.Popen(
            ["docker", "run", *words, "--entrypoint", "python", IMAGE, "-ISuc", BEAT],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
        )
        ready = threading.Event()
        self._reader = threading.Thread(target=self._read, args=(ready,), daemon=True)
        self._reader.start()
        if not ready.wait(READY_S):
            self.__exit__()
            raise TimeoutError(f"no container notes stalls within {READY_S:g} s")
        return self

    def __exit__(self, *_: object) -> None:
        docker("rm", "--force", NAME)
        self._process.wait(READY_S)
        self._reader.join(READY_S)
        assert self._process.stdout is not None
        self._process.stdout.close()

    def _read(self, ready: threading.Event) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.strip() == READY:
                ready.set()
                continue
            # Containers share the kernel's monotonic clock.
            at_s, length_s = map(float, line.split())
            self.stalls.append((at_s, length_s))
