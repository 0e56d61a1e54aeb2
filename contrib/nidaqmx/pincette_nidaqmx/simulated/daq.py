"""NI-DAQmx as seen through an NI gRPC Device Server: a table of calls, without I/O.

A request is a method's name, NUL and its message; a reply ``ok`` NUL message, ``ni-error`` NUL code
NUL text, or ``status`` NUL name NUL text. Messages are those of the package nidaqmx 1.7.0; as in
NI's server, a refusal contains NI's code and the status UNKNOWN, and the reply to a buffered read
contains its status. Only the calls that the drivers use are implemented. The statuses for sessions
that exist already, or do not exist, are assumed.
"""

import threading
import time
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError, Message
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx.constants import FillMode, RegenerationMode
from nidaqmx.error_codes import DAQmxErrors
from session_pb2 import Session

from pincette_nidaqmx.simulated.daq_device import Device, NotYetError
from pincette_nidaqmx.simulated.daq_task import DaqError, Task, Terminals, WiredRig

SERVICE = b"/nidaqmx_grpc.NiDAQmx/"
VERSION = {0x1272: 26, 0x1923: 8, 0x2F22: 0}
"""Attributes of the driver's version: major, minor, update."""
TASK_NAME, AVAILABLE, REGENERATION = 0x1276, 0x1223, 0x1453
BUFFER_SIZES = {0x186C: "ai", 0x186D: "ao"}
INITIALIZE, ATTACH = 1, 2
POLL_S = 0.0005
LONGEST_WAIT_S = 10.0


class _StatusError(Exception):
    """Error for a call that the server itself rejects: the name of a gRPC status and its text."""

    def __init__(self, name: str, text: str) -> None:
        super().__init__(text)
        self.name = name


class SimulatedDaq:
    """Device server with its wired instruments; calls may come from any thread.

    In real time a read waits for its samples. In lockstep it does not wait, since no sample can
    arrive meanwhile.
    """

    def __init__(self, rig: WiredRig, terminals: Terminals, *, lockstep: bool) -> None:
        self._device = Device(rig, terminals)
        self._terminals = terminals
        self._lockstep = lockstep
        self._made = 0
        self._lock = threading.Lock()

    def idle(self) -> None:
        """Do nothing: this instrument acts only on commands."""

    def answer(self, line: bytes) -> bytes | None:
        """Execute one call; returns None if the request is not a call."""
        method, parted, payload = line.partition(b"\0")
        if not parted or not method.startswith(SERVICE):
            return None
        name = method.removeprefix(SERVICE).decode(errors="replace")
        try:
            reply = self._carry_out(name, payload)
        except DaqError as error:
            return b"ni-error\0%d\0%s" % (error.code, str(error).encode())
        except _StatusError as error:
            return b"status\0%s\0%s" % (error.name.encode(), str(error).encode())
        return b"ok\0" + reply.SerializeToString()

    def side(self, line: bytes) -> str:
        """Return the instrument that a call is for: ``sensor``, ``output``, or neither."""
        method, _, payload = line.partition(b"\0")
        name = method.removeprefix(SERVICE).decode(errors="replace")
        if name in ("CreateAIVoltageChan", "CreateAOVoltageChan"):
            return "sensor" if "AI" in name else "output"
        with self._lock:
            try:
                task = self._device.tasks.get(_request(name, payload).task.id)
            except (_StatusError, AttributeError):
                return ""
            return {"ai": "sensor", "ao": "output"}.get((task and task.kind) or "", "")

    def _carry_out(self, name: str, payload: bytes) -> Message:
        request = _request(name, payload)
        call = self.calls.get(name)
        if call is None:
            raise _StatusError("UNIMPLEMENTED", f"{name} is not simulated")
        began_s = time.monotonic()
        while True:
            with self._lock:
                try:
                    return call(request)
                except NotYetError:
                    wait_s = min(request.timeout, LONGEST_WAIT_S)
                    if self._lockstep or time.monotonic() - began_s > wait_s:
                        return _too_late(name)
            time.sleep(POLL_S)

    @cached_property
    def calls(self) -> dict[str, Callable[[Any], Message]]:
        """Return the known calls by name."""
        return {
            "GetSystemInfoAttributeUInt32": self._system_info,
            "GetErrorString": self._error_string,
            "CreateTask": self._create_task,
            "GetTaskAttributeString": self._task_attribute,
            "CreateAIVoltageChan": self._create_input,
            "CreateAOVoltageChan": self._create_output,
            "CfgSampClkTiming": self._clock,
            "SetBufferAttributeUInt32": self._buffer,
            "SetWriteAttributeInt32": self._regeneration,
            "StartTask": self._start,
            "StopTask": self._stop,
            "ClearTask": self._clear,
            "IsTaskDone": self._is_done,
            "GetReadAttributeUInt32": self._read_attribute,
            "ReadAnalogScalarF64": self._read_one,
            "ReadAnalogF64": self._read,
            "WriteAnalogScalarF64": self._write_one,
            "WriteAnalogF64": self._write,
        }

    def _task(self, request: Any) -> Task:
        task = self._device.tasks.get(request.task.id)
        if task is None:
            raise DaqError(DAQmxErrors.INVALID_TASK, "Task specified is invalid or does not exist.")
        return task

    def _system_info(self, request: Any) -> Message:
        value = VERSION.get(request.attribute_raw)
        if value is None:
            raise _no_attribute(request)
        return messages.GetSystemInfoAttributeUInt32Response(value=value)

    def _error_string(self, request: Any) -> Message:
        try:
            words = DAQmxErrors(request.error_code).name.replace("_", " ").capitalize() + "."
        except ValueError:
            words = ""
        return messages.GetErrorStringResponse(error_string=words)

    def _create_task(self, request: Any) -> Message:
        name, behavior = request.session_name, request.initialization_behavior
        for number, task in self._device.tasks.items():
            if name and task.name == name:
                if behavior == INITIALIZE:
                    raise _StatusError("ALREADY_EXISTS", f"session {name!r} exists already")
                return messages.CreateTaskResponse(task=Session(id=number))
        if behavior == ATTACH:
            raise _StatusError("FAILED_PRECONDITION", f"there is no session {name!r}")
        self._made += 1
        self._device.tasks[self._made] = Task(name or f"_unnamedTask<{self._made}>")
        session = Session(id=self._made)
        return messages.CreateTaskResponse(task=session, new_session_initialized=True)

    def _task_attribute(self, request: Any) -> Message:
        task = self._task(request)
        if request.attribute_raw != TASK_NAME:
            raise _no_attribute(request)
        return messages.GetTaskAttributeStringResponse(value=task.name)

    def _create_input(self, request: Any) -> Message:
        task = self._task(request)
        self._terminals.check("ai", request.physical_channel)
        task.add("ai", request.physical_channel, request.min_val, request.max_val)
        return messages.CreateAIVoltageChanResponse()

    def _create_output(self, request: Any) -> Message:
        task = self._task(request)
        self._terminals.check("ao", request.physical_channel)
        task.add("ao", request.physical_channel, request.min_val, request.max_val)
        return messages.CreateAOVoltageChanResponse()

    def _clock(self, request: Any) -> Message:
        mode, count = request.sample_mode_raw, request.samps_per_chan
        self._task(request).clock(request.rate, mode, count)
        return messages.CfgSampClkTimingResponse()

    def _buffer(self, request: Any) -> Message:
        task = self._task(request)
        if BUFFER_SIZES.get(request.attribute_raw) != task.kind:
            raise _no_attribute(request)
        task.buffer_size = request.value
        return messages.SetBufferAttributeUInt32Response()

    def _regeneration(self, request: Any) -> Message:
        task = self._task(request)
        if request.attribute_raw != REGENERATION or task.kind != "ao":
            raise _no_attribute(request)
        task.regenerates = request.value_raw == RegenerationMode.ALLOW_REGENERATION.value
        return messages.SetWriteAttributeInt32Response()

    def _start(self, request: Any) -> Message:
        self._device.start(self._task(request))
        return messages.StartTaskResponse()

    def _stop(self, request: Any) -> Message:
        self._device.stop(self._task(request))
        return messages.StopTaskResponse()

    def _clear(self, request: Any) -> Message:
        self._device.stop(self._task(request))
        del self._device.tasks[request.task.id]
        return messages.ClearTaskResponse()

    def _is_done(self, request: Any) -> Message:
        return messages.IsTaskDoneResponse(is_task_done=self._device.is_done(self._task(request)))

    def _read_attribute(self, request: Any) -> Message:
        task = self._task(request)
        if request.attribute_raw != AVAILABLE:
            raise _no_attribute(request)
        return messages.GetReadAttributeUInt32Response(value=self._device.available(task))

    def _read_one(self, request: Any) -> Message:
        task = self._task(request)
        if len(task.channels) > 1:
            raise DaqError(
                DAQmxErrors.ONE_CHAN_READ_FOR_MULTI_CHAN_TASK,
                "Single-channel read cannot be performed on a multi-channel task.",
            )
        voltages_V = self._device.read(task, 1)
        return messages.ReadAnalogScalarF64Response(value=float(voltages_V[0, 0]))

    def _read(self, request: Any) -> Message:
        """Read samples; a status of the device is in the reply, as in NI's server."""
        task = self._task(request)
        try:
            voltages_V = self._device.read(task, request.num_samps_per_chan)
        except DaqError as error:
            return messages.ReadAnalogF64Response(status=error.code)
        if voltages_V.size > request.array_size_in_samps:
            return messages.ReadAnalogF64Response(status=int(DAQmxErrors.READ_BUFFER_TOO_SMALL))
        order = "C" if request.fill_mode_raw == FillMode.GROUP_BY_CHANNEL.value else "F"
        values: list[float] = voltages_V.ravel(order).tolist()
        count = np.shape(voltages_V)[1]
        return messages.ReadAnalogF64Response(read_array=values, samps_per_chan_read=count)

    def _write_one(self, request: Any) -> Message:
        wanted_V = np.asarray([request.value])
        self._device.write(self._task(request), wanted_V, request.auto_start)
        return messages.WriteAnalogScalarF64Response()

    def _write(self, request: Any) -> Message:
        wanted_V = np.asarray(request.write_array, dtype=np.float64)
        self._device.write(self._task(request), wanted_V, request.auto_start)
        written = len(request.write_array)
        return messages.WriteAnalogF64Response(samps_per_chan_written=written)


def _request(name: str, payload: bytes) -> Any:
    kind = getattr(messages, f"{name}Request", None)
    if kind is None:
        raise _StatusError("UNIMPLEMENTED", f"there is no call {name}")
    try:
        return kind.FromString(payload)
    except DecodeError as error:
        raise _StatusError("INTERNAL", f"{name}: no such message ({error})") from error


def _too_late(name: str) -> Message:
    status = DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE
    if name == "ReadAnalogF64":
        return messages.ReadAnalogF64Response(status=int(status))
    raise DaqError(status, "Some or all of the samples requested have not yet been acquired.")


def _no_attribute(request: Any) -> DaqError:
    return DaqError(
        DAQmxErrors.ATTR_NOT_SUPPORTED,
        f"Specified property is not supported: 0x{request.attribute_raw:x}",
    )
