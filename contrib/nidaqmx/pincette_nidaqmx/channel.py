"""NI-DAQmx channels from urls, and the check for the package that they need."""

import re
from collections.abc import Generator
from contextlib import contextmanager
from urllib.parse import urlsplit

from pincette.config import ConfigError
from pincette.instruments.protocols import InstrumentError

LOCAL, SERVER = "ni:", "grpc://"
CHANNEL = re.compile(r"[\w-]+/\w+")
EXCHANGE_S = 0.001
"""Assumed duration of a call to this machine or a device server in the same network, in s."""


def channel_of(url: str, channel: str) -> str:
    """Return the physical channel of a url, or the given one if the url names none.

    Raises
    ------
    ConfigError
        If neither names a channel, or the name is not valid.
    """
    named = channel
    if url.startswith(LOCAL):
        named = url.removeprefix(LOCAL)
    elif url.startswith(SERVER):
        named = urlsplit(url).path.strip("/") or channel
    if CHANNEL.fullmatch(named) is None:
        raise ConfigError(
            f"url = {url!r}: {named!r} is not a physical channel; expected ni:DEVICE/CHANNEL "
            "or grpc://HOST:PORT/DEVICE/CHANNEL, or the option channel, as in cDAQ1Mod1/ai0"
        )
    return named


@contextmanager
def needing_the_package(url: str) -> Generator[None]:
    """Import code that needs the package; raises InstrumentError if it is not installed."""
    try:
        yield
    except ImportError as error:
        raise InstrumentError(
            f"{url}: the package nidaqmx is not installed ({error}); install pincette with its "
            "extra: pip install 'pincette[nidaqmx]'",
            "cannot_open",
        ) from error
