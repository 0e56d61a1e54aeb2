"""What the controller takes from the rig file."""

from dataclasses import dataclass

from pincette.config import RigFile
from pincette.control.impedance import ImpedanceParameters, discretize_impedance
from pincette.control.pbsmic import PbsmicParameters
from pincette.control.plant import discretize


@dataclass(frozen=True, slots=True)
class ControllerConfig:
    """The law with its model and gains."""

    period_s: float
    law: PbsmicParameters


def configure(rig: RigFile) -> ControllerConfig:
    """Take the controller's part of a rig file."""
    model, law, period_s = rig.model, rig.law, rig.rig.period_s
    impedance = ImpedanceParameters(M=law.M, B=law.B, K=law.K, K_f=law.K_f)
    return ControllerConfig(
        period_s=period_s,
        law=PbsmicParameters(
            plant=discretize(model.arm(), period_s),
            impedance=discretize_impedance(impedance, period_s),
            K_P=law.K_P,
            K_I=law.K_I,
            K_S=law.K_S,
            delta=law.delta,
        ),
    )
