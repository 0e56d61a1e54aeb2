"""State of a rig when a job is planned."""

from dataclasses import dataclass

from pincette.config import RigFile
from pincette.config.derived import X_START_UM
from pincette.control.laws.two_arms import Pair
from pincette.control.planning.recorded_motion import RecordedMotion
from pincette.core.faults import Fault

RESTS_V = 0.01
"""Voltage up to which an arm that is free counts as at rest at 0 V."""


@dataclass(frozen=True, slots=True)
class Present:
    """Voltage applied, position measured, and whether a part is held; None: unknown."""

    voltage_V: float | None = None
    x_um: float | None = None
    held: bool | None = None
    recorded: RecordedMotion | None = None
    """Motion of the job that the request plays again; None: it names none."""
    second_V: float | None = None
    second_um: float | None = None
    """Of the second arm, where there is one."""
    memory_known: bool | None = None
    """Whether the estimator knows the past of the arm's hysteresis well enough for a force."""
    stroke: Fault | None = None
    """The estimator's finding that the stroke of an arm has changed; None: it has none."""
    pose_um: float | None = None
    """Target or rest of the last move, where the arm still stands there; see ``last_pose``."""
    force_mN: float | None = None
    """Force on a part that is held, the mean of two arms; None: not known, or none is held."""
    force_uncertainty_mN: float | None = None
    """Expanded uncertainty of that force; of two arms the larger one."""

    def stand_V(self, rig: RigFile) -> float:
        """Return the voltage applied, or where that is not known the rig file's safe voltage."""
        return rig.safety.safe_V if self.voltage_V is None else self.voltage_V

    def stand_um(self, rig: RigFile) -> float:
        """Return the position, or where that is not known the one that the voltage stands for."""
        if self.x_um is not None:
            return self.x_um
        return X_START_UM + rig.model.piezo_um_per_V * self.stand_V(rig)

    @property
    def tips_um(self) -> Pair | None:
        """Return the positions of both arms; None where one of them is not known."""
        if self.x_um is None or self.second_um is None:
            return None
        return self.x_um, self.second_um

    def rest_um(self) -> float | None:
        """Return the position of an arm that rests at 0 V and holds no part; None: not known."""
        if self.voltage_V is None or abs(self.voltage_V) > RESTS_V or self.held:
            return None
        return self.x_um
