"""Simulated NI-DAQmx device: its tasks, their reservations, and the rig at its terminals."""

from dataclasses import dataclass, field

import numpy as np
from nidaqmx.error_codes import DAQmxErrors

from pincette_nidaqmx.simulated.daq_task import (
    LIMIT_V,
    STEP_V,
    DaqError,
    Samples,
    Task,
    Terminals,
    WiredRig,
    converted_V,
)

MOST_SAMPLES = 10_000_000


class NotYetError(Exception):
    """Error of a read whose samples have not arrived yet."""


@dataclass(slots=True)
class Device:
    """One simulated device, or several in one chassis, and its tasks."""

    rig: WiredRig
    terminals: Terminals
    output_V: float = 0.0
    """Last single output value, in V."""
    tasks: dict[int, Task] = field(default_factory=dict[int, Task])

    def start(self, task: Task) -> None:
        """Start a task; in lockstep the start of a waveform ends the tick."""
        task.must_have_channels()
        if task.started:
            return
        task.started = True
        try:
            self._begin(task)
        except DaqError:
            task.started = False
            raise

    def _begin(self, task: Task) -> None:
        for other in self.tasks.values():
            if other is not task and other.reserved() == task.reserved():
                raise DaqError(
                    DAQmxErrors.PAL_RESOURCE_RESERVED,
                    "The specified resource is reserved. The operation could not be completed as "
                    f"specified.\n\nTask Name: {other.name}",
                )
        if not task.rate_hz:
            return
        try:
            if task.kind == "ai":
                self.rig.begin_capture(task.rate_hz)
                first_V = [[self._input_V(name)] for name in task.channels]
                task.pending_V, task.overwritten = converted_V(np.asarray(first_V)), False
            else:
                self._play(task)
        except ValueError as error:
            raise DaqError(DAQmxErrors.INVALID_ATTRIBUTE_VALUE, f"Not possible: {error}") from error

    def _play(self, task: Task) -> None:
        begun_V = task.begun_V()
        self.rig.put_out_wave(begun_V, task.rate_hz)
        self.output_V = begun_V[-1]

    def _go_on(self, task: Task) -> None:
        """Add written samples to a playing output; raises an error if it has run out of samples."""
        try:
            if task.waiting_V:
                self.output_V = task.waiting_V[-1]
                self.rig.extend_wave(task.waiting_V)
                task.waiting_V = []
                return
        except ValueError as error:
            raise _dry(task) from error
        if task.wanting and self.rig.wave_over:
            raise _dry(task)

    def stop(self, task: Task) -> None:
        """Stop a task. A waveform plays on until the next write, unlike a real one, since in
        lockstep nothing may reach the rig between two ticks.
        """
        if task.started and task.rate_hz and task.kind == "ai":
            self.rig.end_capture()
        if task.started:
            task.written, task.waiting_V = 0, []
        task.started = False

    def is_done(self, task: Task) -> bool:
        """Return whether a task has ended; in lockstep this call ends the tick if a waveform
        plays.
        """
        if not task.started:
            return True
        if not task.rate_hz or task.kind == "ai":
            return False
        self._go_on(task)
        over = self.rig.wave_over
        self.rig.go_on()
        return over

    def available(self, task: Task) -> int:
        """Return the number of samples per channel in the buffer of an input."""
        self._collect(task)
        return task.pending_V.shape[1]

    def read(self, task: Task, count: int) -> Samples:
        """Read inputs, shape (channels, count); a count of -1 means all samples."""
        task.must_have_channels()
        if task.kind != "ai" or not -1 <= count <= MOST_SAMPLES:
            raise DaqError(
                DAQmxErrors.INVALID_ATTRIBUTE_VALUE, f"Cannot read {count} samples of this task."
            )
        if not task.rate_hz:
            rows = [[self._input_V(name) for name in task.channels] for _ in range(abs(count))]
            return converted_V(np.asarray(rows, dtype=np.float64).reshape(-1, len(task.channels)).T)
        if not task.started:
            self.start(task)
        there = self.available(task)
        if there < count and not task.overwritten:
            raise NotYetError
        return task.take(there if count < 0 else count)

    def write(self, task: Task, wanted_V: Samples, auto_start: bool) -> None:
        """Write samples to the buffer of an output, or output a single value directly."""
        task.must_have_channels()
        if task.kind != "ao" or not bool(np.all(np.abs(wanted_V) <= LIMIT_V)):
            raise DaqError(
                DAQmxErrors.INVALID_AO_DATA_WRITE,
                "Attempted writing analog data that is too large or too small.",
            )
        samples_V: list[float] = converted_V(wanted_V).tolist()
        if task.rate_hz:
            task.load(samples_V)
            if task.started:
                self._go_on(task)
            elif auto_start:
                self.start(task)
            return
        if not task.started and not auto_start:
            raise DaqError(
                DAQmxErrors.CANNOT_WRITE_WHEN_AUTO_START_FALSE_AND_TASK_NOT_RUNNING,
                "Write cannot be performed when the auto start input is false and the task is not "
                "running.",
            )
        for voltage_V in samples_V:
            self.output_V = voltage_V
            self.rig.put_out(voltage_V)

    def _collect(self, task: Task) -> None:
        """Move the samples that the rig has stored into the task's buffer."""
        if not task.started or not task.rate_hz:
            return
        try:
            x_um, drive_V = self.rig.drain()
        except ValueError:
            task.overwritten = True
            return
        if not x_um:
            return
        at_V = (np.asarray(x_um) - self.terminals.offset_um) / self.terminals.um_per_V
        seen = {name: np.asarray(drive_V) for name in self.terminals.drives}
        seen[self.terminals.position] = at_V
        task.keep(converted_V(np.stack([seen[name] for name in task.channels])))

    def _input_V(self, name: str) -> float:
        if name == self.terminals.position:
            x_um = self.rig.measure_um()
            return (x_um - self.terminals.offset_um) / self.terminals.um_per_V
        return round(self.output_V / STEP_V) * STEP_V


def _dry(task: Task) -> DaqError:
    return DaqError(
        DAQmxErrors.GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES,
        "The generation has stopped to prevent the regeneration of old samples.\n\n"
        f"Samples: {task.written} of {task.count}",
    )
