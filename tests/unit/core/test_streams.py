"""Output of programs that continue whether or not it can be written."""

import fcntl
import io
import os
import pty
from collections.abc import Callable
from contextlib import suppress
from threading import Thread
from time import monotonic, sleep
from typing import TextIO

import pytest

from pincette.core.streams import MOST_PENDING, LossyWriter


def _ended_pipe() -> TextIO:
    reader, writer = os.pipe()
    os.close(reader)
    return os.fdopen(writer, "w")


def _full_disk() -> TextIO:
    return os.fdopen(os.open("/dev/full", os.O_WRONLY), "w")


def _closed() -> TextIO:
    stream = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")
    stream.close()
    return stream


def _lost_terminal() -> TextIO:
    master, slave = pty.openpty()
    os.close(master)
    return os.fdopen(slave, "w")


@pytest.mark.parametrize("made", [_ended_pipe, _full_disk, _closed, _lost_terminal])
def test_output_that_cannot_be_written_is_counted_and_raises_nothing(
    made: Callable[[], TextIO],
) -> None:
    behind = made()
    output = LossyWriter(behind)
    for _ in range(3):
        print("rig demo is up", file=output, flush=True)
    assert output.drain(10.0)
    assert output.lost > 0
    with suppress(OSError, ValueError):
        behind.close()


def test_a_paused_reader_blocks_no_output() -> None:
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    output = LossyWriter(os.fdopen(writer, "w"))
    begun_s = monotonic()
    for _ in range(MOST_PENDING + 500):
        output.write("x" * 100)
    assert not output.drain(0.1)
    assert output.lost >= 400
    assert monotonic() - begun_s < 5.0
    os.close(reader)


def test_output_resumes_once_it_can_be_written() -> None:
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    output = LossyWriter(os.fdopen(writer, "w"))
    with suppress(BlockingIOError):
        while True:
            os.write(writer, bytes(4096))
    output.write("lost\n")
    until_s = monotonic() + 10.0
    while not output.lost and monotonic() < until_s:
        sleep(0.01)
    assert output.lost == 1
    os.set_blocking(reader, False)
    with suppress(BlockingIOError):
        while os.read(reader, 65536):
            pass
    output.write("shown\n")
    assert output.drain(10.0)
    assert os.read(reader, 100) == b"shown\n"
    os.close(reader)


def test_characters_that_the_encoding_lacks_are_replaced() -> None:
    reader, writer = os.pipe()
    output = LossyWriter(io.TextIOWrapper(os.fdopen(writer, "wb"), encoding="ascii"))
    output.write("● 5 µm\n")
    assert output.drain(10.0)
    assert output.lost == 0
    assert os.read(reader, 100) == b"? 5 ?m\n"
    os.close(reader)


def test_long_texts_arrive_completely_and_in_order() -> None:
    reader, writer = os.pipe()
    behind = os.fdopen(writer, "w")
    output = LossyWriter(behind)
    found = bytearray()

    def read() -> None:
        while part := os.read(reader, 4096):
            found.extend(part)

    thread = Thread(target=read)
    thread.start()
    texts = [f"{number:06d}" * 5000 for number in range(20)]
    for text in texts:
        output.write(text)
    assert output.drain(30.0)
    assert output.lost == 0
    behind.close()
    thread.join(10.0)
    assert found.decode() == "".join(texts)
    os.close(reader)


def test_a_stream_in_memory_works_too() -> None:
    behind = io.StringIO()
    output = LossyWriter(behind)
    output.write("text")
    assert output.drain(10.0)
    assert output.lost == 0
    assert behind.getvalue() == "text"
