"""The law a job runs with, where the job says nothing else."""

from typing import Literal

from pincette.config.tables import NotNegative, Positive, Table
from pincette.control.laws.law import LawSettings


class Law(Table):
    """Scheme, parameter set, gains, and the generalized impedance (10) in mN and µm."""

    scheme: Literal["pbsmic", "dsmifc"] = "pbsmic"
    """PBSMIC or DSMIFC."""
    set: Literal["consistent", "printed"] = "consistent"
    """Whose m, b, k, d the law works with: the rig's, or those that the paper prints."""
    K_P: NotNegative = 1.0
    """Of the sliding function, proportional."""
    K_I: Positive = 1.0
    """Of the sliding function, integral."""
    K_S: NotNegative = 0.0
    """mN. Of the switching term; 0: there is none."""
    delta: Positive = 100.0
    """Half width of the boundary layer: µm for PBSMIC, mN for DSMIFC."""
    M: NotNegative = 1e-3
    """mN·s²/µm. Of the generalized impedance (10)."""
    B: NotNegative = 8.9221
    """mN·s/µm. Of the generalized impedance (10)."""
    K: Positive = 1.9901e4
    """mN/µm. Of the generalized impedance (10)."""
    K_f: NotNegative = 5000.0
    """mN/mN. Of the force error in the generalized impedance (10)."""
    force_age: Literal["planned", "newest"] = "planned"
    """F_k: the newest estimate as it is, or carried on to k by the change of F_r."""

    def settings(self) -> LawSettings:
        """What the controller makes its law of."""
        return LawSettings(**self.model_dump())
