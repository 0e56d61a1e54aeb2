"""Sets the wall clock of every program that is started with this folder on its PYTHONPATH.

What ``time.time`` and ``time.time_ns`` say is shifted by the number of seconds that the file named
by ``PINCETTE_TEST_CLOCK`` holds; the monotonic clock stays as it is.
"""

import os
import threading
import time
from pathlib import Path

LOOK_S = 0.05
shift_s = [0.0]
place = Path(os.environ["PINCETTE_TEST_CLOCK"])
true_s, true_ns = time.time, time.time_ns


def follow() -> None:
    """Read the file repeatedly."""
    while True:
        text = place.read_text(encoding="utf-8") if place.exists() else ""
        shift_s[0] = float(text) if text else shift_s[0]
        time.sleep(LOOK_S)


time.time = lambda: true_s() + shift_s[0]
time.time_ns = lambda: true_ns() + round(shift_s[0] * 1e9)
threading.Thread(target=follow, daemon=True).start()
