"""Open loop: voltages output sample by sample, and the response of the rig."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, pi

import numpy as np
from numpy.typing import NDArray

from pincette.config import Simulation
from pincette.core.messages import GroundTruth
from pincette.sim.rig.rig import SimulatedRig

Series = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Motion:
    """N samples, each with the state that the previous voltages have caused."""

    period_s: float
    voltage_V: Series
    """Voltage output at the previous sample, in V, which caused the position in ``x_um``."""
    x_um: Series
    """Position from the sensor, in µm."""
    true_x_um: Series
    true_force_mN: Series

    def tail(self, samples: int) -> "Motion":
        """Return the last samples."""
        return Motion(
            self.period_s,
            self.voltage_V[-samples:],
            self.x_um[-samples:],
            self.true_x_um[-samples:],
            self.true_force_mN[-samples:],
        )


def drive(simulation: Simulation, voltage_V: Sequence[float], period_s: float) -> Motion:
    """Output a voltage each period on a rig that starts unpoled, and sample before each output."""
    truths: list[GroundTruth] = []
    rig = SimulatedRig(
        simulation,
        period_s,
        lockstep=True,
        clock=lambda: 0.0,
        truth=truths.append,
    )
    x_um: list[float] = []
    for value in voltage_V:
        x_um.append(rig.measure_um())
        rig.put_out(value)
    true = np.array([(truth.arms[0].x_um, truth.arms[0].force_mN) for truth in truths])
    return Motion(
        period_s,
        np.array([0.0, *voltage_V[:-1]]),
        np.array(x_um),
        true[:, 0],
        true[:, 1],
    )


def raised_sinusoid(
    peak_to_peak_V: float, frequency_hz: float, cycles: int, period_s: float
) -> list[float]:
    """Return U/2·(1 - cos 2πft): whole cycles that begin at 0 V and stay above it."""
    samples = round(cycles / (frequency_hz * period_s))
    return [
        0.5 * peak_to_peak_V * (1.0 - cos(2.0 * pi * frequency_hz * index * period_s))
        for index in range(samples)
    ]


def peak_to_peak(values: Series) -> float:
    """Return the largest minus the smallest value."""
    return float(values.max() - values.min())
