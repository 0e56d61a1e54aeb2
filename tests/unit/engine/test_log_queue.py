"""Log lines through a queue: a pipe without a reader delays no thread that logs."""

import logging
import os
import subprocess
import sys
import threading
from collections.abc import Generator
from pathlib import Path
from time import monotonic

import pytest

from pincette.engine.log_queue import CAPACITY, END_S, LogQueue

ROOT = Path(__file__).parents[3]
MANY = 5 * CAPACITY
PATIENCE_S = 20.0
TEXT = logging.Formatter("%(levelname)s %(message)s")


@pytest.fixture
def pipe() -> Generator[tuple[int, int]]:
    reading, writing = os.pipe()
    yield reading, writing
    os.close(reading)
    os.close(writing)


def logger_of(lines: LogQueue) -> logging.Logger:
    found = logging.Logger("test")
    found.addHandler(lines)
    return found


def read_until(reading: int, end: bytes) -> list[str]:
    found = b""
    while end not in found:
        found += os.read(reading, 1 << 16)
    return found.decode().splitlines()


def test_an_unread_pipe_delays_no_line_and_the_lost_lines_are_counted(
    pipe: tuple[int, int],
) -> None:
    lines = LogQueue(TEXT, pipe[1], capacity=10)
    log = logger_of(lines)
    longest_s = 0.0
    for number in range(5000):  # some 130 kB, and the pipe holds 64
        begun_s = monotonic()
        log.warning("line %05d of the program", number)
        longest_s = max(longest_s, monotonic() - begun_s)
    assert longest_s < 1.0
    assert lines.dropped > 0
    reader = threading.Thread(target=lambda: found.extend(read_until(pipe[0], b"the end")))
    found = list[str]()
    reader.start()
    lines.flush()
    log.warning("the end")
    reader.join(PATIENCE_S)
    written = [line for line in found if line.endswith("of the program")]
    reported = [int(line.split()[1]) for line in found if "log lines were dropped" in line]
    assert sum(reported) == lines.dropped
    assert len(written) + lines.dropped == 5000


def test_a_record_is_written_as_it_was_when_it_was_logged(pipe: tuple[int, int]) -> None:
    log, words = logger_of(LogQueue(TEXT, pipe[1])), ["first"]
    try:
        raise OSError("gone")
    except OSError:
        log.exception("%s", words)
    words[0] = "second"
    log.info("the end")
    assert read_until(pipe[0], b"the end")[0] == "ERROR ['first']"


def test_a_write_that_fails_ends_nothing_and_is_counted(pipe: tuple[int, int]) -> None:
    full = os.open("/dev/full", os.O_WRONLY)
    try:
        lines = LogQueue(TEXT, full)
        logger_of(lines).error("x")
        lines.flush()
        assert lines.dropped == 1
        os.dup2(pipe[1], full)
        logger_of(lines).error("y")
        assert read_until(pipe[0], b"ERROR y\n")[0].startswith("WARNING 1 log lines were dropped")
    finally:
        os.close(full)


FLOOD = f"""
import logging
from pincette.engine.logs import begin
begin("sensor", "text")
for number in range({MANY}):
    logging.getLogger("a").warning("line %06d of a program with a stopped reader", number)
print("done", flush=True)
"""


def test_a_program_ends_even_if_its_log_is_not_read() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", FLOOD], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT
    ) as program:
        assert program.stdout is not None
        assert program.stdout.read() == b"done\n"
        ended_s = monotonic()
        assert program.wait(PATIENCE_S) == 0
        assert monotonic() - ended_s < END_S + PATIENCE_S / 2.0


def test_the_last_lines_before_the_end_are_written() -> None:
    short = FLOOD.replace(str(MANY), "300")
    ran = subprocess.run([sys.executable, "-c", short], capture_output=True, check=True, cwd=ROOT)
    assert ran.stderr.count(b"\n") == 300
