"""Voltage at an analog output of NI-DAQmx: single values, and waveforms from the buffer.

From the package nidaqmx 1.7.0 and its documentation. Assumed: the output holds its voltage while no
task owns it, and a finite waveform can start before all its samples are written, provided that
regeneration of old samples is disabled.

A waveform is written while it plays: the first half second before the start, then a quarter of a
second at each ``look``. So even a long waveform starts at once, and it stops soon after a failure
of the host.

A step of the voltage can be output in parts, that is as a short waveform. A separate task plays it,
and is stopped, written and started again for each step. Assumed: its first sample is output when it
starts.
"""

import logging
from array import array
from collections.abc import Sequence
from math import isfinite
from time import monotonic, sleep
from typing import Any

import numpy as np
from nidaqmx.constants import AcquisitionType, RegenerationMode
from nidaqmx.stream_readers import AnalogSingleChannelReader
from nidaqmx.stream_writers import AnalogSingleChannelWriter

from pincette.instruments.protocols import InstrumentError
from pincette_nidaqmx.tasks import Daq, TaskGoneError

BEGIN_S, LOOK_S = 0.5, 0.25
"""Duration of the waveform, in s, that is written before the start, and at each call of ``look``.
At least four calls per second are needed.
"""
LEAST_SAMPLES = 2
"""Least number of samples of a buffered output."""

Samples = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

_log = logging.getLogger(__name__)


class AnalogOutput:
    """One channel with three tasks: for single values, for waveforms, and for steps in parts.

    Only one task uses the channel at a time.
    """

    def __init__(self, daq: Daq, *, least_V: float, most_V: float, rate_hz: float) -> None:
        self._daq = daq
        self._least_V, self._most_V = least_V, most_V
        self._rate_hz = rate_hz
        self._single: Any = None
        self._wave: Any = None
        self._parts: Any = None
        self._parts_of = 0, 0.0
        """Number of parts and interval in s for which the parts task was created."""
        self._playing = False
        self._stepping = False
        """True while the parts task uses the channel."""
        self._stepped_s = 0.0
        """Monotonic time in s at which all parts have been output."""
        self._held_V: float | None = None
        """Present output voltage in V; None while a waveform plays."""
        self._wave_V: Sequence[float] = ()
        self._written = 0
        """Number of samples of the waveform that the device has received."""
        self._look_samples = LEAST_SAMPLES

    def prepare(self, read_channel: str, found_V: float) -> None:
        """Clear tasks left by an earlier program, and find the present output voltage."""
        for purpose in ("single", "wave", "parts", "reading"):
            self._daq.take_back(purpose)
        self._begin_single()
        self._wave = self._daq.task("wave", self._add)
        if read_channel:
            self._held_V = self._measured_V(read_channel)
            return
        _log.warning(
            "%s: the output cannot be read back; %g V is assumed (option found_V, or read_channel)",
            self._daq.channel,
            found_V,
        )
        self._held_V = found_V

    def write_V(self, voltage_V: float) -> None:
        """Output a voltage; this ends a playing waveform and the parts of a step.

        Raises
        ------
        InstrumentError
            If the voltage is not a number within the range, before anything is sent; if the
            device refuses it or does not answer.
        """
        self._daq.must_be_open()
        self._must_be_within(voltage_V)
        if self._released():
            self._resume()
        if self._single is None:
            self._begin_single()
        single: Any = self._single
        writer: Any = AnalogSingleChannelWriter(single.out_stream)
        try:
            self._daq.ask("writing", writer.write_one_sample, float(voltage_V), self._daq.wait_s)
        except TaskGoneError:
            self._drop()
            raise
        self._held_V = voltage_V

    def read_V(self) -> float:
        """Return the output voltage in V, as it was last written or found.

        Raises
        ------
        InstrumentError
            While a waveform plays.
        """
        self._daq.must_be_open()
        if self._held_V is None:
            text = f"{self._daq.channel}: a wave plays; its voltage cannot be read back"
            raise InstrumentError(text, "misused")
        if self._stepping:
            sleep(max(0.0, self._stepped_s - monotonic()))
        return self._held_V

    def write_parts(self, voltages_V: Sequence[float], interval_s: float) -> None:
        """Output one voltage every ``interval_s``, the first one immediately; the output keeps the
        last one.

        Raises
        ------
        InstrumentError
            If the interval or a voltage is beyond its limit, before anything is sent; if the
            device refuses or does not answer.
        """
        self._daq.must_be_open()
        if not (len(voltages_V) >= LEAST_SAMPLES and interval_s * self._rate_hz >= 1.0):
            text = (
                f"step in {len(voltages_V)} parts of {interval_s:g} s refused, limits "
                f"{LEAST_SAMPLES} parts and {1.0 / self._rate_hz:g} s"
            )
            raise InstrumentError(f"{self._daq.channel}: {text}", "misused")
        samples_V = self._checked(voltages_V)
        if not self._released() and self._single is not None:
            self._daq.ask("ending single values", self._single.stop)
        try:
            parts = self._parts_task(len(voltages_V), interval_s)
            self._daq.ask("writing a step in parts", self._feed, parts, samples_V)
            self._daq.ask("beginning a step in parts", parts.start)
        except InstrumentError:
            self._drop()
            raise
        self._stepping = True
        self._stepped_s = monotonic() + len(voltages_V) * interval_s
        self._held_V = voltages_V[-1]

    def _parts_task(self, count: int, interval_s: float) -> Any:
        """Return the task for this number of parts and interval; create it if necessary."""
        if self._parts is not None and self._parts_of == (count, interval_s):
            return self._parts
        if (old := self._parts) is not None:
            self._parts = None
            self._daq.clear("parts", old)

        def arrange(task: Any) -> None:
            self._add(task)
            task.timing.cfg_samp_clk_timing(
                1.0 / interval_s, sample_mode=AcquisitionType.FINITE, samps_per_chan=count
            )
            task.out_stream.output_buf_size = count
            task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION

        self._parts, self._parts_of = self._daq.task("parts", arrange), (count, interval_s)
        return self._parts

    def begin_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:
        """Output one voltage every 1/rate; the output keeps the last one.

        Raises
        ------
        InstrumentError
            If the rate or a voltage in the first block is beyond its limit, before anything is
            sent; if the device refuses.
        """
        self._daq.must_be_open()
        if not 0.0 < rate_hz <= self._rate_hz:
            text = f"wave at {rate_hz:g} Hz refused, limit {self._rate_hz:g} Hz"
            raise InstrumentError(f"{self._daq.channel}: {text}", "misused")
        if not voltages_V:
            raise InstrumentError(f"{self._daq.channel}: a wave without samples", "misused")
        if len(voltages_V) < LEAST_SAMPLES:
            voltages_V = [voltages_V[0]] * LEAST_SAMPLES
        first = self._checked(voltages_V[: max(LEAST_SAMPLES, round(BEGIN_S * rate_hz))])
        if not self._released() and self._single is not None:
            self._daq.ask("ending single values", self._single.stop)
        try:
            if self._wave is None:
                self._wave = self._daq.task("wave", self._add)
            self._daq.ask("beginning a wave", self._play, first, len(voltages_V), rate_hz)
        except InstrumentError:
            self._drop()
            raise
        self._playing = True
        self._wave_V, self._written = voltages_V, first.size
        self._look_samples = max(1, round(LOOK_S * rate_hz))
        self._held_V = None

    def look(self) -> None:
        """Write more samples of the waveform; raises InstrumentError if it has stopped early, or
        none plays.
        """
        self._daq.must_be_open()
        if not self._playing:
            raise InstrumentError(f"{self._daq.channel}: no wave plays", "misused")
        if self._written < len(self._wave_V):
            end = self._written + self._look_samples
            more = self._checked(self._wave_V[self._written : end])
            self._daq.ask("resuming the wave", self._feed, self._wave, more)
            self._written += more.size
        if self._daq.ask("the wave", self._wave.is_task_done):
            self._held_V = self._wave_V[-1]

    def close(self) -> None:
        """Release tasks and line; the output stays unchanged. Repeated calls do nothing."""
        self._daq.close({"wave": self._wave, "parts": self._parts, "single": self._single})

    def _must_be_within(self, voltage_V: float) -> None:
        if not (isfinite(voltage_V) and self._least_V <= voltage_V <= self._most_V):
            text = f"{voltage_V} V refused, limits {self._least_V} V and {self._most_V} V"
            raise InstrumentError(f"{self._daq.channel}: {text}", "misused")

    def _checked(self, voltages_V: Sequence[float]) -> Samples:
        # Filling an array of the standard library from a tuple is four times as fast as with numpy.
        samples_V = np.frombuffer(array("d", voltages_V))
        for end_V in (samples_V.min(), samples_V.max()):
            self._must_be_within(float(end_V))
        return samples_V

    def _begin_single(self) -> None:
        def arrange(task: Any) -> None:
            self._add(task)
            task.start()

        self._single = self._daq.task("single", arrange)

    def _play(self, first: Samples, count: int, rate_hz: float) -> None:
        task = self._wave
        task.timing.cfg_samp_clk_timing(
            rate_hz, sample_mode=AcquisitionType.FINITE, samps_per_chan=count
        )
        task.out_stream.output_buf_size = count
        task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
        self._feed(task, first)
        task.start()

    def _released(self) -> bool:
        """End a waveform or the parts of a step; return True if one of them was in progress."""
        if self._playing:
            self._playing = False
            if not self._stopped("wave", self._wave):
                self._wave = None
            return True
        if self._stepping:
            self._stepping = False
            if not self._stopped("parts", self._parts):
                self._parts = None
            return True
        return False

    def _stopped(self, purpose: str, task: Any) -> bool:
        """Stop a task, and clear it if that fails; return whether it can be started again."""
        try:
            self._daq.ask(f"ending {purpose}", task.stop)
        except InstrumentError as error:
            _log.info("%s", error)
            self._daq.clear(purpose, task)
            return False
        return True

    def _resume(self) -> None:
        """Let the task for single values use the output again."""
        if self._single is None:
            return
        try:
            self._daq.ask("going back to single values", self._single.start)
        except InstrumentError:
            self._drop()
            raise

    def _drop(self) -> None:
        """Discard the tasks, so that the next write or waveform creates new ones."""
        tasks = {"wave": self._wave, "parts": self._parts, "single": self._single}
        self._wave = self._parts = self._single = None
        self._playing = self._stepping = False
        for purpose, task in tasks.items():
            if task is not None:
                self._daq.clear(purpose, task)

    def _feed(self, task: Any, samples_V: Samples) -> None:
        writer: Any = AnalogSingleChannelWriter(task.out_stream)
        writer.verify_array_shape = False
        writer.write_many_sample(samples_V, self._daq.wait_s)

    def _add(self, task: Any) -> None:
        task.ao_channels.add_ao_voltage_chan(
            self._daq.channel, min_val=self._least_V, max_val=self._most_V
        )

    def _measured_V(self, channel: str) -> float:
        def arrange(task: Any) -> None:
            task.ai_channels.add_ai_voltage_chan(
                channel, min_val=self._least_V, max_val=self._most_V
            )

        task = self._daq.task("reading", arrange)
        reader: Any = AnalogSingleChannelReader(task.in_stream)
        try:
            wait_s = self._daq.wait_s
            voltage_V = float(self._daq.ask("reading back", reader.read_one_sample, wait_s))
        finally:
            self._daq.clear("reading", task)
        if not isfinite(voltage_V):
            raise InstrumentError(f"{channel}: {voltage_V} V is not a valid reading", "invalid")
        return voltage_V
