"""The arm as the controller and the estimator know it, and the law's gains."""

from typing import Literal

from pydantic import Field, model_validator

from pincette.config.tables import NotNegative, Positive, Table
from pincette.control.hysteresis import HysteresisModel
from pincette.control.plant import ArmParameters, consistent_arm, printed_arm


class IdentifiedFreeResponse(Table):
    """The free response as ``pincette teach`` identified it; see ``control.hysteresis``."""

    thresholds_V: tuple[float, ...] = Field(strict=False)
    weights_um_per_V: tuple[float, ...] = Field(strict=False)
    creep_times_s: tuple[float, ...] = Field(default=(), strict=False)
    creep_fractions: tuple[float, ...] = Field(default=(), strict=False)
    residual_um: NotNegative
    """r.m.s. left of free motion that was not fitted; enters the force uncertainty."""

    @model_validator(mode="after")
    def _possible(self) -> "IdentifiedFreeResponse":
        self.hysteresis()
        return self

    def hysteresis(self) -> HysteresisModel:
        """Model of the table; raises ValueError where it is impossible."""
        return HysteresisModel(
            thresholds_V=self.thresholds_V,
            weights_um_per_V=self.weights_um_per_V,
            creep_times_s=self.creep_times_s,
            creep_fractions=self.creep_fractions,
        )


class Model(Table):
    """The arm as the controller and the estimator know it."""

    parameters: Literal["consistent", "printed"] = "consistent"
    natural_frequency_rad_per_s: Positive = 2437.8
    damping_ratio: Positive = 0.0260
    piezo_um_per_V: Positive = 19.0
    compliance_um_per_mN: Positive = 0.46
    hysteresis_fraction: NotNegative = 0.06
    """Error of the linear free response, as a share of the voltage travel since the zero."""
    creep_mN_per_decade: NotNegative = 0.3
    """Growth of the force uncertainty per decade of zero age."""
    forgotten_mN: NotNegative = 3.0
    """Force uncertainty, at most, from what a to-and-fro of the voltage makes the arm forget."""
    forgotten_scale_V: Positive = 0.4
    """To-and-fro since the zero within which 63 % of it is reached."""
    force_filter_s: NotNegative = 0.03
    """Time constant of the low-pass over the estimated force."""
    free_response: IdentifiedFreeResponse | None = None
    """Without it the free response is a straight line."""

    def arm(self) -> ArmParameters:
        """m, b, k, d of the set that is named."""
        if self.parameters == "printed":
            return printed_arm()
        return consistent_arm(
            self.natural_frequency_rad_per_s,
            self.damping_ratio,
            self.piezo_um_per_V,
            self.compliance_um_per_mN,
        )


class Law(Table):
    """Gains of PBSMIC and of the generalized impedance (10), in mN and µm."""

    K_P: Positive = 1.0
    K_I: Positive = 1.0
    K_S: NotNegative = 0.0
    delta: Positive = 100.0
    M: Positive = 1e-3
    B: Positive = 8.9221
    K: Positive = 1.9901e4
    K_f: NotNegative = 5000.0
