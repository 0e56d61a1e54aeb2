"""A closed loop to be played, and what came of it."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.config import RigFile
from pincette.control.planning.program import Program
from pincette_batch.kernel.lane import COLUMNS, Ending

Series = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Case:
    """A simulated rig in lockstep that starts unpoled, and a program with its one law."""

    rig: RigFile
    program: Program
    seed: int | None = None
    """Of the sensor's noise; None: the rig file's."""


@dataclass(frozen=True, slots=True)
class Run:
    """A loop, tick by tick. Ages are those of one sample k: measured, estimated, put out."""

    ending: Ending
    outcome: str
    """The controller's last outcome, or why the kernel does not follow on."""
    columns: Series
    """Shape (``lane.COLUMNS``, ticks)."""
    phases: tuple[str, ...]
    """Of the program's segments."""

    def column(self, name: str) -> Series:
        """One of ``lane.COLUMNS``, shape (ticks,); raises ValueError for another name."""
        return self.columns[COLUMNS.index(name)]

    @property
    def x_um(self) -> Series:
        """As measured."""
        return self.column("x_um")

    @property
    def force_mN(self) -> Series:
        """As estimated."""
        return self.column("force_mN")

    @property
    def voltage_V(self) -> Series:
        """As applied."""
        return self.column("voltage_V")

    def during(self, phase: str) -> Series:
        """Columns of one phase, shape (``lane.COLUMNS``, its ticks)."""
        among = np.array([name == phase for name in self.phases])
        return self.columns[:, among[self.column("segment").astype(np.int64)]]

    def rmse(self, phase: str) -> tuple[float, float]:
        """x - x_r in µm as measured, and F - F_r in mN as it truly was, over a phase."""
        part = self.during(phase)

        def off(one: str, other: str) -> float:
            apart: Series = part[COLUMNS.index(one)] - part[COLUMNS.index(other)]
            return sqrt(float(np.mean(apart**2)))

        return off("x_um", "x_r_um"), off("true_force_mN", "force_r_mN")
