"""The law a job runs with, where the job says nothing else."""

from typing import Literal

from pincette.config.tables import NotNegative, Positive, Table
from pincette.control.laws.law import LawSettings


class Law(Table):
    """Scheme, parameter set, gains, and the generalized impedance (10) in mN and µm."""

    scheme: Literal["pbsmic", "dsmifc"] = "pbsmic"
    set: Literal["consistent", "printed"] = "consistent"
    K_P: NotNegative = 1.0
    K_I: Positive = 1.0
    K_S: NotNegative = 0.0
    delta: Positive = 100.0
    M: NotNegative = 1e-3
    B: NotNegative = 8.9221
    K: Positive = 1.9901e4
    K_f: NotNegative = 5000.0
    force_age: Literal["planned", "newest"] = "planned"

    def settings(self) -> LawSettings:
        """What the controller makes its law of."""
        return LawSettings(**self.model_dump())
