"""Watch over a closing arm for the kink with which it meets something.

Along one branch of rising voltage the position of a free arm rises with d_p·u, at a slope that
hysteresis changes little by little. Where the arm touches a spring K_e the slope drops at once, by
the share s_p·K_e/(1 + s_p·K_e).
"""

from dataclasses import dataclass
from math import inf, sqrt

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.record import FrozenRecord

LEAST_STEP_UM = 1.0
NEW_GROUND_STEPS = 2.0
"""Steps of ``KinkLimits`` by which a kink may lie before the furthest position so far."""
STEP_OVER_NOISE = 6.0
"""Standard deviations of the sensor's noise in a slope that the kink must exceed."""


@dataclass(frozen=True, slots=True)
class KinkLimits:
    """What counts as a kink."""

    step_um: float
    """Travel of d_p·u over which a slope is drawn."""
    drop: float
    """Fall of dx/(d_p·du) from one step to the next, or the one after."""


def kink_limits(
    softest_mN_per_um: float, compliance_um_per_mN: float, noise_um: float
) -> KinkLimits:
    """Half the drop of the softest part there may be, over a step that noise cannot bend so.

    Raises
    ------
    ValueError
        Where K_e or s_p is not positive, or the noise negative.
    """
    K_e = require_positive("softest contact", softest_mN_per_um, "mN/µm")
    ratio = K_e * require_positive("compliance", compliance_um_per_mN, "µm/mN")
    drop = 0.5 * ratio / (1.0 + ratio)
    noise = require_not_negative("sensor noise", noise_um, "µm")
    return KinkLimits(max(LEAST_STEP_UM, STEP_OVER_NOISE * sqrt(2.0) * noise / drop), drop)


class DetectedContact(FrozenRecord, frozen=True):
    """Where the arm met something, and how it had moved until there."""

    x_um: float
    nominal_um: float
    slope: float
    on_new_ground: bool = False
    """Whether the arm had not been as far before; a kink where it has been is one of its own."""

    def pushed_back_um(self, x_um: float, nominal_um: float) -> float:
        """How far the arm lacks to where it would be, had it gone on as before the touch."""
        return self.x_um + self.slope * (nominal_um - self.nominal_um) - x_um


class ContactDetector(FrozenRecord, frozen=True):
    """The last two steps of the branch, and the touch on it.

    It counts along d_p·u and not along x_1, since a model of the hysteresis that is made of plays
    has kinks of its own.
    """

    nominal_um: float
    x_um: float
    """At the end of the last step."""
    slope: float = -inf
    """Of the last step; -inf where there was none on this branch, so that none can fall from it."""
    nominal_2_um: float = 0.0
    x_2_um: float = 0.0
    slope_2: float = -inf
    """Of the step before; one that touches on its way has a slope between."""
    touch: DetectedContact | None = None
    free_to_um: float = -inf
    """Furthest that the arm has been before the touch."""

    def restarted(self, x_um: float, nominal_um: float) -> "ContactDetector":
        """Begin anew, with the ground that is known to be free."""
        return ContactDetector(nominal_um, x_um, free_to_um=self.free_to_um)

    def follow(self, limits: KinkLimits, x_um: float, nominal_um: float) -> "ContactDetector":
        """Take in x_k and d_p·u_{k-1}; within a step nothing changes."""
        travel_um = nominal_um - self.nominal_um
        if -limits.step_um < travel_um < limits.step_um:
            return self
        touch, free_to_um = self.touch, self.free_to_um
        if travel_um < 0.0:
            if touch is not None and nominal_um < touch.nominal_um:
                touch = None
            return ContactDetector(nominal_um, x_um, touch=touch, free_to_um=free_to_um)
        slope = (x_um - self.x_um) / travel_um
        if touch is None or not touch.on_new_ground:
            met = None
            if slope < self.slope - limits.drop:
                met = self._met(limits, self.x_um, self.nominal_um, self.slope)
            elif slope < self.slope_2 - limits.drop:
                met = self._met(limits, self.x_2_um, self.nominal_2_um, self.slope_2)
            # A kink where the arm has been before does not hide one where it has not.
            if met is not None and (touch is None or met.on_new_ground):
                touch = met
        if touch is None or not touch.on_new_ground:
            free_to_um = max(free_to_um, x_um)
        return ContactDetector(
            nominal_um, x_um, slope, self.nominal_um, self.x_um, self.slope, touch, free_to_um
        )

    def _met(
        self, limits: KinkLimits, x_um: float, nominal_um: float, slope: float
    ) -> DetectedContact:
        # The step that found no kink may have reached beyond it.
        on_new_ground = x_um >= self.free_to_um - NEW_GROUND_STEPS * limits.step_um
        return DetectedContact(x_um, nominal_um, slope, on_new_ground)
