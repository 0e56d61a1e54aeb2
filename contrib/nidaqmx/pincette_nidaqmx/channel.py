"""Where an NI-DAQmx channel is, by its url, and whether there is a package to reach it with."""

import re
from collections.abc import Generator
from contextlib import contextmanager
from urllib.parse import urlsplit

from pincette.config import ConfigError
from pincette.instruments.protocols import InstrumentError

LOCAL, SERVER = "ni:", "grpc://"
CHANNEL = re.compile(r"[\w-]+/\w+")
EXCHANGE_S = 0.001
"""Of a call, at this machine or at a device server in the same network; assumed."""


def channel_of(url: str, channel: str) -> str:
    """Physical channel of a url, or the one given where the url names none.

    Raises
    ------
    ConfigError
        Where neither names one, or what is named is none.
    """
    named = channel
    if url.startswith(LOCAL):
        named = url.removeprefix(LOCAL)
    elif url.startswith(SERVER):
        named = urlsplit(url).path.strip("/") or channel
    if CHANNEL.fullmatch(named) is None:
        raise ConfigError(
            f"url = {url!r}: {named!r} is no physical channel; wanted ni:DEVICE/CHANNEL or "
            "grpc://HOST:PORT/DEVICE/CHANNEL, or the option channel, as in cDAQ1Mod1/ai0"
        )
    return named


@contextmanager
def needing_the_package(url: str) -> Generator[None]:
    """Import within it what needs the package; InstrumentError where it is not installed."""
    try:
        yield
    except ImportError as error:
        raise InstrumentError(
            f"{url}: the package nidaqmx is not installed ({error}); install pincette with its "
            "extra: pip install 'pincette[nidaqmx]'",
            "cannot_open",
        ) from error
