"""A rig connected to a simulated NI device; the tests advance its time."""

from collections.abc import Callable, Sequence

from pincette_nidaqmx.simulated.daq_task import Terminals

POSITION, DRIVE, OUTPUT = "cDAQ1Mod1/ai0", "cDAQ1Mod1/ai1", "cDAQ1Mod2/ao0"
WIRED = Terminals(um_per_V=10.0, position=POSITION, drives=(DRIVE,), output=OUTPUT)


class HandRig:
    """Rig that stores received data; a position that is not a number is an invalid reading."""

    def __init__(self, measure: Callable[[], float | None] = lambda: 0.0) -> None:
        self.now_s = 0.0
        self.voltages_V: list[float] = []
        self.wave: tuple[list[float], float] | None = None
        self.went_on = 0
        self.capture_hz = 0.0
        self.wave_over = False
        self.overflown = False
        self._measure = measure
        self._drained_s = 0.0

    def measure_um(self) -> float:
        x_um = self._measure()
        return float("nan") if x_um is None else x_um

    def put_out(self, voltage_V: float, /) -> None:
        self.voltages_V.append(voltage_V)

    def put_out_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:
        self.wave = list(voltages_V), rate_hz
        self.wave_over = False

    def extend_wave(self, voltages_V: Sequence[float]) -> None:
        if self.wave is None or self.wave_over:
            raise ValueError("the wave is over")
        self.wave[0].extend(voltages_V)

    def go_on(self) -> None:
        self.went_on += 1

    def begin_capture(self, rate_hz: float) -> None:
        if self.capture_hz:
            raise ValueError("a capture is running")
        self.capture_hz, self._drained_s = rate_hz, self.now_s

    def drain(self) -> tuple[list[float], list[float]]:
        if self.overflown:
            raise ValueError("samples were lost")
        count = round((self.now_s - self._drained_s) * self.capture_hz)
        self._drained_s = self.now_s
        x_um = [self.measure_um() + 0.01 * (index + 1) for index in range(count)]
        return x_um, [0.25] * count

    def end_capture(self) -> None:
        self.capture_hz = 0.0
