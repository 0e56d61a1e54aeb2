"""Position as a voltage at an analog input of NI-DAQmx.

From the package nidaqmx 1.7.0 and its documentation. Assumed: the module samples its channels at
one instant (a multiplexed module samples the second channel one conversion later), and a voltage
beyond the range reads as the end of the range. A reading within the last step at either end counts
as over range.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from nidaqmx.constants import AcquisitionType
from nidaqmx.stream_readers import AnalogMultiChannelReader, AnalogSingleChannelReader

from pincette.instruments.protocols import Block, InstrumentError
from pincette_nidaqmx.tasks import Daq, TaskGoneError

BUFFER_S = 20.0
MOST_SAMPLES = 100_000
"""Samples per channel and call: 1.6 MB of the 4 MB that a gRPC message may have by default."""
CODES = 65536
"""Number of steps in the range; the coarsest of these converters has 16 bit."""


@dataclass(frozen=True, slots=True)
class Scale:
    """Linear scale: the position is ``offset_um`` + ``um_per_V`` · voltage, within a range."""

    um_per_V: float
    offset_um: float
    least_V: float
    most_V: float

    def position_um(self, voltage_V: float, where: str) -> float:
        """Return the position of a voltage in µm; raises InstrumentError at an end of the range."""
        step_V = (self.most_V - self.least_V) / CODES
        high = voltage_V >= self.most_V - 1.5 * step_V
        if high or voltage_V <= self.least_V + 0.5 * step_V:
            side = "above" if high == (self.um_per_V > 0.0) else "below"
            text = f"{where}: {side} the measuring range ({voltage_V:+.4f} V)"
            raise InstrumentError(text, "out_of_range")
        return self.offset_um + self.um_per_V * voltage_V


class AnalogInput:
    """Analog input for the position, with a second one for the drive voltage of the amplifier."""

    def __init__(
        self, daq: Daq, scale: Scale, *, drive_channel: str, average: int, rate_hz: float
    ) -> None:
        self._daq = daq
        self._scale = scale
        self._drive_channel = drive_channel
        self._average = average
        self._rate_hz = rate_hz
        self._single: Any = None
        self._capture: Any = None

    def prepare(self) -> None:
        """Clear tasks left by an earlier program, and start reading on demand."""
        for purpose in ("single", "capture"):
            self._daq.take_back(purpose)
        self._begin_single()

    def read_um(self) -> float:
        """Return the position in µm, read on demand; the mean of ``average`` samples.

        Raises
        ------
        InstrumentError
            If the voltage is at an end of its range, or the device does not answer.
        """
        self._daq.must_be_open()
        if self._capture is not None:
            raise InstrumentError(f"{self._daq.channel}: a capture is running; end it", "misused")
        if self._single is None:
            self._begin_single()
        try:
            voltage_V = self._voltage_V()
        except TaskGoneError:
            self._drop()
            raise
        return self._scale.position_um(voltage_V, self._daq.channel)

    def begin_capture(self, rate_hz: float) -> None:
        """Start sampling position and drive voltage at ``rate_hz``, into a buffer for 20 s.

        Raises
        ------
        InstrumentError
            If the rate is too high, no drive channel is named, or the device refuses.
        """
        self._daq.must_be_open()
        self.end_capture()
        if not self._drive_channel:
            text = f"{self._daq.channel}: a capture needs the option drive_channel"
            raise InstrumentError(text, "misused")
        if not 0.0 < rate_hz <= self._rate_hz:
            text = f"capture at {rate_hz:g} Hz refused, limit {self._rate_hz:g} Hz"
            raise InstrumentError(f"{self._daq.channel}: {text}", "misused")
        if self._single is not None:
            self._daq.ask("ending single readings", self._single.stop)

        def arrange(task: Any) -> None:
            count = round(BUFFER_S * rate_hz)
            self._add(task, self._daq.channel)
            self._add(task, self._drive_channel)
            task.timing.cfg_samp_clk_timing(
                rate_hz, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=count
            )
            task.in_stream.input_buf_size = count
            task.start()

        try:
            self._capture = self._daq.task("capture", arrange)
        except InstrumentError:
            self._drop()
            raise

    def read_block(self) -> Block:
        """Return all samples since the last block, waiting for the first of them.

        Raises
        ------
        InstrumentError
            If no sample came in time, the buffer has overflowed, or a position is at an end of its
            range.
        """
        self._daq.must_be_open()
        if self._capture is None:
            raise InstrumentError(f"{self._daq.channel}: no capture was started", "misused")
        stream = self._capture.in_stream
        left = max(1, self._daq.ask("asking for samples", lambda: stream.avail_samp_per_chan))
        parts = [self._samples_V(min(left, MOST_SAMPLES))]
        for begin in range(MOST_SAMPLES, left, MOST_SAMPLES):
            parts.append(self._samples_V(min(left - begin, MOST_SAMPLES)))
        position_V, drive_V = np.concatenate(parts, axis=1)
        for end_V in (position_V.min(), position_V.max()):
            self._scale.position_um(float(end_V), self._daq.channel)
        x_um = self._scale.offset_um + self._scale.um_per_V * position_V
        return Block(tuple(x_um.tolist()), tuple(drive_V.tolist()))

    def end_capture(self) -> None:
        """Return to single readings; does nothing without a capture."""
        if self._capture is None:
            return
        task, self._capture = self._capture, None
        self._daq.clear("capture", task)
        if self._single is not None:
            try:
                self._daq.ask("going back to single readings", self._single.start)
            except InstrumentError:
                self._drop()
                raise

    def close(self) -> None:
        """Release tasks and line; repeated calls do nothing."""
        self._daq.close({"capture": self._capture, "single": self._single})

    def _begin_single(self) -> None:
        def arrange(task: Any) -> None:
            self._add(task, self._daq.channel)
            task.start()

        self._single = self._daq.task("single", arrange)

    def _drop(self) -> None:
        """Discard the task, so that the next reading creates a new one."""
        task, self._single = self._single, None
        if task is not None:
            self._daq.clear("single", task)

    def _add(self, task: Any, channel: str) -> None:
        scale = self._scale
        task.ai_channels.add_ai_voltage_chan(channel, min_val=scale.least_V, max_val=scale.most_V)

    def _voltage_V(self) -> float:
        reader: Any = AnalogSingleChannelReader(self._single.in_stream)
        if self._average == 1:
            voltage_V = float(self._daq.ask("reading", reader.read_one_sample, self._daq.wait_s))
        else:
            reader.verify_array_shape = False
            data = np.full(self._average, np.nan)
            wait_s = self._daq.wait_s
            self._daq.ask("reading", reader.read_many_sample, data, self._average, wait_s)
            voltage_V = float(data.mean())
        if not np.isfinite(voltage_V):
            text = f"{self._daq.channel}: invalid reading ({voltage_V} V)"
            raise InstrumentError(text, "invalid")
        return voltage_V

    def _samples_V(self, count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        """Read ``count`` samples of position and drive, shape (2, count); all of them finite."""
        data = np.full((2, count), np.nan)
        reader: Any = AnalogMultiChannelReader(self._capture.in_stream)
        reader.verify_array_shape = False
        self._daq.ask("reading", reader.read_many_sample, data, count, self._daq.wait_s)
        if not np.isfinite(data).all():
            text = (
                f"{self._daq.channel}: fewer than {count} samples, or some of them are not numbers"
            )
            raise InstrumentError(text, "invalid")
        return data
