"""An arm that lives on over restarts of all programs, written for the campaign alone.

    voltage   output lag, gain of the amplifier
    motion    hysteresis of one class, gain of the piezo, creep from 0.05 s to 800 s, hung weight
    tip       one mode, free or pressed against a linear part that may give way
    reading   gain of the sensor, drift, white noise; the instrument rounds it

Nothing here is shared with the simulated plant of the product, and only the instruments' bytes are.
Units: µm, mN, V, s. Time advances by whole periods, one for each voltage that is put out.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tests.support.campaign.hysteresis import Hysteresis

CREEP_TIMES_S = tuple(0.05 * 10.0 ** (0.5 * step) for step in range(9))
SUBSTEP_S, MODE_SUBSTEP_S = 1e-3, 2.5e-4
TOUCH_STEPS = 40
"""Number of parts of a substep in which the tip can make or lose contact."""
OUTPUT_STEP_V = 20.0 / 2**14


class Truth(NamedTuple):
    """True state of the arm at one sample."""

    x_um: float
    force_mN: float
    voltage_V: float
    """Voltage that the output holds."""


@dataclass
class Part:
    """The part that the arm presses: one elastic face."""

    contact_um: float
    stiffness_mN_per_um: float
    slip_force_mN: float | None = None
    """Force above which the face gives way by ``slip_um``; None: it does not."""
    slip_um: float = 0.0
    slips_left: int = 0


@dataclass
class Arm:
    """A piezoelectric arm, its output and its sensor."""

    hysteresis: Hysteresis
    gain_um_per_V: float
    """Motion in µm for each unit of the hysteresis' motion."""
    compliance_um_per_mN: float
    omega_per_s: float
    damping: float
    creep_per_decade: float
    lag_s: float
    delay_s: float
    """Time from a sample to the effect of its voltage, in s."""
    noise_um: float
    drift_um_per_s: float
    """Steepest drift of the reading, a sinusoid of ``drift_cycle_s``."""
    drift_cycle_s: float
    period_s: float
    seed: int
    amplifier: float = 1.0
    piezo: float = 1.0
    sensor: float = 1.0
    part: Part | None = None
    hung_mN: float = 0.0
    slips: int = field(default=0, init=False)
    peak_mN: float = field(default=0.0, init=False)
    """Largest contact force since it was set to 0, by the substep."""
    ticks: int = field(default=0, init=False)
    voltage_V: float = field(default=0.0, init=False)
    x_um: float = field(default=0.0, init=False)
    speed_um_per_s: float = field(default=0.0, init=False)
    time_s: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self._chance = np.random.default_rng((0xA3, self.seed))
        self._creep = [0.0] * len(CREEP_TIMES_S)
        self._output_V = 0.0
        self._free_um = self._free(0.0, 0.0)

    # Functions for instruments and programs.

    def now_s(self) -> float:
        """Return the time as instruments count it."""
        return self.ticks * self.period_s

    def set_averaging(self, averaging_s: float) -> None:
        """Accept the sensor's averaging time; readings are those of single samples."""

    def pass_time(self) -> None:
        """Do nothing: time passes with each voltage."""

    def measure_um(self) -> float:
        """Return the sensor's reading."""
        drift_um = self._drift_um()
        return self.sensor * self.x_um + drift_um + float(self._chance.normal(0.0, self.noise_um))

    def put_out(self, voltage_V: float) -> None:
        """Output a voltage, which takes effect after ``delay_s``, and let the period pass."""
        self._move(self.delay_s)
        self.voltage_V = round(voltage_V / OUTPUT_STEP_V) * OUTPUT_STEP_V
        self._move(self.period_s - self.delay_s)
        self.ticks += 1

    # Functions for people.

    def hang(self, weight_mN: float) -> None:
        """Hang a weight on the tip instead of the previous one; positive pulls it back."""
        self.hung_mN = weight_mN

    def rest(self, rest_s: float) -> None:
        """Let time pass at the present output voltage, with no program running."""
        self._move(min(rest_s, 2.0))
        if rest_s > 2.0:
            self._free_um = self._free(self._output_V, rest_s - 2.0)
            self._settle()

    @property
    def force_mN(self) -> float:
        """True contact force."""
        part = self.part
        if part is None:
            return 0.0
        return max(0.0, part.stiffness_mN_per_um * (self.x_um - part.contact_um))

    @property
    def truth(self) -> Truth:
        """True state now."""
        return Truth(self.x_um, self.force_mN, self.voltage_V)

    def _drift_um(self) -> float:
        turn = 2.0 * math.pi * self.time_s / self.drift_cycle_s
        return self.drift_um_per_s * self.drift_cycle_s / (2.0 * math.pi) * math.sin(turn)

    def _free(self, output_V: float, dt_s: float) -> float:
        """Advance hysteresis and creep to a voltage and return the rest position of the free
        arm."""
        y_um = self.piezo * self.gain_um_per_V * self.hysteresis.to(self.amplifier * output_V)
        push_um = 0.5 * self.creep_per_decade * y_um
        for index, time_s in enumerate(CREEP_TIMES_S):
            self._creep[index] += (self._creep[index] - push_um) * math.expm1(-dt_s / time_s)
        self.time_s += dt_s
        return y_um + sum(self._creep) - self.compliance_um_per_mN * self.hung_mN

    def _settle(self) -> None:
        part, kappa = self.part, 0.0
        self.x_um, self.speed_um_per_s = self._free_um, 0.0
        if part is not None and self._free_um > part.contact_um:
            kappa = self.compliance_um_per_mN * part.stiffness_mN_per_um
            self.x_um = (self._free_um + kappa * part.contact_um) / (1.0 + kappa)

    def _move(self, span_s: float) -> None:
        steps = max(1, math.ceil(span_s / SUBSTEP_S - 1e-9))
        dt_s = span_s / steps
        if dt_s <= 0.0:
            return
        lag = math.exp(-dt_s / self.lag_s) if self.lag_s > 0.0 else 0.0
        for _ in range(steps):
            self._output_V = self.voltage_V + lag * (self._output_V - self.voltage_V)
            self._free_um = self._free(self._output_V, dt_s)
            self._ring(dt_s)
            self.peak_mN = max(self.peak_mN, self.force_mN)

    def _ring(self, span_s: float) -> None:
        """Advance the tip by its mode, free or pressed."""
        steps = max(1, math.ceil(span_s / MODE_SUBSTEP_S - 1e-9))
        for _ in range(steps):
            x_um, speed = self.x_um, self.speed_um_per_s
            pressed = self._pressed()
            self._swing(span_s / steps, pressed=pressed)
            if self._pressed() is not pressed:
                # Contact changes within the step: if they were applied only at its end, the tip
                # would gain energy.
                self.x_um, self.speed_um_per_s = x_um, speed
                for _ in range(TOUCH_STEPS):
                    self._swing(span_s / steps / TOUCH_STEPS, pressed=self._pressed())
            self._give_way()

    def _pressed(self) -> bool:
        part = self.part
        return part is not None and self.x_um > part.contact_um

    def _swing(self, dt_s: float, *, pressed: bool) -> None:
        """Advance the tip by a time within which it stays free, or pressed."""
        sigma, part = self.damping * self.omega_per_s, self.part
        rest_um, omega2 = self._free_um, self.omega_per_s**2
        if pressed:
            assert part is not None
            kappa = self.compliance_um_per_mN * part.stiffness_mN_per_um
            rest_um = (self._free_um + kappa * part.contact_um) / (1.0 + kappa)
            omega2 *= 1.0 + kappa
        damped = math.sqrt(omega2 - sigma**2)
        away_um, speed = self.x_um - rest_um, self.speed_um_per_s
        decay, cos, sin = (
            math.exp(-sigma * dt_s),
            math.cos(damped * dt_s),
            math.sin(damped * dt_s),
        )
        quadrature = (speed + sigma * away_um) / damped
        self.x_um = rest_um + decay * (away_um * cos + quadrature * sin)
        self.speed_um_per_s = decay * (speed * cos - (sigma * quadrature + damped * away_um) * sin)

    def _give_way(self) -> None:
        part = self.part
        if part is None or part.slip_force_mN is None or not part.slips_left:
            return
        if self.force_mN > part.slip_force_mN:
            part.contact_um += part.slip_um
            part.slips_left -= 1
            self.slips += 1
