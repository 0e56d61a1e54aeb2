"""Tasks of NI-DAQmx in this machine's driver or a device server; errors are InstrumentError.

The url states the place: ``ni:cDAQ1Mod1/ai0`` is this machine's driver,
``grpc://host:port/cDAQ1Mod1/ai0`` an NI gRPC Device Server. Through the latter every call is an
exchange of bytes over a link. From the package nidaqmx 1.7.0, its errors and its gRPC interpreter;
this code has never been tested with a device.

A task at a device server outlives the program that made it, and keeps its channel reserved. So each
task has a name, by which a restarted program finds and clears it.
"""

import logging
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ParamSpec, TypeVar

import nidaqmx
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError, DaqNotFoundError, DaqNotSupportedError, DaqWarning, Error
from nidaqmx.grpc_session_options import (
    MEASUREMENTLINK_23Q1_NIDAQMX_PYTHON_API_KEY,
    GrpcSessionOptions,
    SessionInitializationBehavior,
)

from pincette.config import Output, Sensor
from pincette.instruments.line.replay import REPLAY
from pincette.instruments.protocols import ErrorCode, InstrumentError, Link
from pincette_nidaqmx.channel import LOCAL, needing_the_package

PATIENCE_S = 2.0
"""Timeout of a call that sets up hardware, in s; assumed."""
SHARE = 0.8
"""Fraction of the timeout for which the device may wait for samples, so that its reply arrives in
time.
"""
QUICK: frozenset[str] = frozenset(
    {
        "GetReadAttributeUInt32",
        "IsTaskDone",
        "ReadAnalogF64",
        "ReadAnalogScalarF64",
        "WriteAnalogF64",
        "WriteAnalogScalarF64",
    }
)
QUICK_WITH_PARTS = QUICK | {"StartTask", "StopTask"}
"""Calls within a tick if steps are written in parts."""
METADATA = (("ni-api-key", MEASUREMENTLINK_23Q1_NIDAQMX_PYTHON_API_KEY),)
GONE = (DAQmxErrors.INVALID_TASK, DAQmxErrors.DEV_CANNOT_BE_ACCESSED)
"""Errors of a task whose server was restarted, or whose device was unplugged."""
CAUSES: dict[int, ErrorCode] = {
    DAQmxErrors.INVALID_TASK: "hung_up",
    DAQmxErrors.DEV_CANNOT_BE_ACCESSED: "hung_up",
    DAQmxErrors.INVALID_DEVICE_ID: "cannot_open",
    DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST: "cannot_open",
    DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE: "silent",
    DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE: "invalid",
}
ABSENT = (
    "NI-DAQmx is not installed on this machine; install NI's driver, or name a device server: "
    "grpc://HOST:PORT/CHANNEL"
)

NO_TASKS: Mapping[str, Any] = {}

_log = logging.getLogger(__name__)

P = ParamSpec("P")
T = TypeVar("T")


class TaskGoneError(InstrumentError):
    """Error for a task that no longer exists and must be created again."""


@dataclass(slots=True)
class Daq:
    """Access to the tasks of one channel; ``link`` is None for the driver of this machine."""

    channel: str
    link: Link | None
    wait_s: float
    """Time for which the device may wait for samples, in s."""
    left: set[str] = field(default_factory=set[str])
    """Purposes of tasks that may still exist at the server, because a call for them failed."""
    _closed: bool = field(default=False, init=False)

    def must_be_open(self) -> None:
        """Raise InstrumentError once the channel has been closed."""
        if self._closed:
            raise InstrumentError(f"{self.channel}: the port is closed; open it again", "misused")

    def ask(self, what: str, call: Callable[P, T], *given: P.args, **named: P.kwargs) -> T:
        """Call the package; raises InstrumentError, with ``what`` in its message, for errors of the
        package.
        """
        try:
            return call(*given, **named)
        except (DaqNotFoundError, DaqNotSupportedError) as error:
            raise InstrumentError(f"{self.channel}: {ABSENT}", "cannot_open") from error
        except DaqError as error:
            code, words = error.error_code, " ".join(str(error).split())
            kind = TaskGoneError if code in GONE else InstrumentError
            raise kind(f"{self.channel}: {what}: {words}", CAUSES.get(code, "refused")) from error
        except Error as error:
            raise InstrumentError(f"{self.channel}: {what}: {error}", "refused") from error
        except (DaqWarning, AssertionError, ValueError, TypeError, OverflowError) as error:
            text = f"{self.channel}: {what}: an impossible answer ({error!r})"
            raise InstrumentError(text) from error

    def task(self, purpose: str, arrange: Callable[[Any], None]) -> Any:
        """Create a task; it is cleared again if ``arrange`` or another step fails."""
        if purpose in self.left:
            self.take_back(purpose)
        task = self._created(purpose, SessionInitializationBehavior.INITIALIZE_SERVER_SESSION)
        try:
            self.ask(f"preparing {purpose}", arrange, task)
        except InstrumentError:
            self.clear(purpose, task)
            raise
        return task

    def take_back(self, purpose: str) -> None:
        """Clear the task that still exists at the server, if there is one."""
        if self.link is None:
            return
        try:
            found = self._created(purpose, SessionInitializationBehavior.ATTACH_TO_SERVER_SESSION)
        except InstrumentError as error:
            if error.code != "refused":
                raise
            self.left.discard(purpose)
            return
        _log.warning("%s: its task %s was left at the device server", self.channel, purpose)
        self.left.discard(purpose)
        self.clear(purpose, found)

    def clear(self, purpose: str, task: Any) -> None:
        """Clear a task; if this fails, try again before the next task of this purpose is
        created.
        """
        try:
            self.ask(f"clearing {purpose}", task.close)
        except TaskGoneError as error:
            _log.info("%s", error)
        except InstrumentError as error:
            self.left.add(purpose)
            _log.info("%s", error)

    def close(self, tasks: Mapping[str, Any] = NO_TASKS) -> None:
        """Close the tasks, given by purpose, and the line; repeated calls do nothing."""
        if self._closed:
            return
        self._closed = True
        for purpose, task in tasks.items():
            if task is not None:
                self.clear(purpose, task)
        if self.link is not None:
            self.link.close()

    def _created(self, purpose: str, behavior: SessionInitializationBehavior) -> Any:
        name = re.sub(r"\W", "_", f"pincette {self.channel} {purpose}")
        options = self._session(name, behavior)
        try:
            return self.ask(f"making {purpose}", nidaqmx.Task, name, grpc_options=options)
        except InstrumentError as error:
            if error.code != "refused":
                self.left.add(purpose)
            raise

    def _session(
        self, name: str, behavior: SessionInitializationBehavior
    ) -> GrpcSessionOptions | None:
        if self.link is None:
            return None
        with needing_the_package(self.channel):
            from pincette_nidaqmx.rpc_link import LinkChannel
        channel: Any = LinkChannel(self.link)
        return GrpcSessionOptions(channel, name, initialization_behavior=behavior)


def open_daq(settings: Sensor | Output, channel: str, link: Link | None, met: bool) -> Daq:
    """Open the access to a channel, or use ``link``.

    ``met`` is True if the driver has been tested with its instrument.

    Raises
    ------
    InstrumentError
        If the line cannot be opened, or cannot be recorded.
    """
    here = link is None and settings.url.startswith(LOCAL)
    if here and settings.record:
        raise InstrumentError(
            f"{settings.url}: calls to the local driver are not byte streams and cannot be "
            "recorded; use a device server, or leave `record` out",
            "misused",
        )
    if link is None and not met and not settings.url.startswith(REPLAY):
        _log.warning(
            "nidaqmx has not been tested with its instrument: it was written from the package's "
            "source"
        )
    if link is None and not here:
        link = _opened(settings)
    return Daq(channel, link, SHARE * settings.timeout_s)


def _opened(settings: Sensor | Output) -> Link:
    with needing_the_package(settings.url):
        from pincette_nidaqmx.rpc_link import open_rpc_link
    return open_rpc_link(
        settings.url,
        timeout_s=settings.timeout_s,
        patience_s=PATIENCE_S,
        quick=QUICK_WITH_PARTS if isinstance(settings, Output) and settings.shaping else QUICK,
        metadata=METADATA,
        record=settings.record,
    )
