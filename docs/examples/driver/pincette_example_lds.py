"""Displacement sensor for this example: ``POS1?`` is answered by ``+00012.58``, in µm."""

import re
from dataclasses import dataclass

from pydantic import Field

from pincette.config import Sensor, Table
from pincette.instruments.link import open_link
from pincette.instruments.options import read_options
from pincette.instruments.protocols import InstrumentError, Link, PositionSensor

MET = False
VALUE = re.compile(rb"[+-]\d{5}\.\d{2}")
NAME = re.compile(rb"LDS,.*")
READING = re.compile(rb"[+-]\d{5}\.\d{2}|OVER|UNDER|LOST")
BEYOND = {b"OVER": "above the measuring range", b"UNDER": "below the measuring range"}


class _Options(Table):
    head: int = Field(default=1, ge=1, le=4)
    baud: int = 9600


@dataclass(frozen=True, slots=True)
class _LDS:
    link: Link
    request: bytes

    def read_um(self) -> float:
        reply = self.link.exchange(self.request)
        if VALUE.fullmatch(reply) is None:
            raise InstrumentError(f"LDS: {BEYOND.get(reply, 'invalid reading')} ({reply[:40]!r})")
        return float(reply)

    def close(self) -> None:
        self.link.close()


def open_sensor(settings: Sensor, link: Link | None = None) -> PositionSensor:
    """Open the port, or use ``link``, and check that an LDS answers."""
    options = read_options(_Options, "example_lds", settings.options)
    link = link or open_link(
        settings.url,
        baud=options.baud,
        timeout_s=settings.timeout_s,
        answers=lambda request: NAME if request == b"*IDN?" else READING,
        probes=(b"*IDN?",),
    )
    try:
        if not (name := link.exchange(b"*IDN?")).startswith(b"LDS,"):
            raise InstrumentError(f"{settings.url}: {name[:40]!r} is not the name of an LDS")
    except InstrumentError:
        link.close()
        raise
    return _LDS(link, b"POS%d?" % options.head)
