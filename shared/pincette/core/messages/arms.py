"""Records of one arm. Messages contain one record per arm of a rig, the first arm first."""

from pincette.control.quantities import Micrometre, Millinewton, Number, Second, Volt, Whole
from pincette.control.record import FrozenRecord
from pincette.core.faults import Fault

ARM_PREFIXES = ("", "second.")
"""Prefix of the names of each arm's quantities, in tables, rig files and faults."""


class ArmPosition(FrozenRecord, frozen=True):
    """Measured position of one arm's tip."""

    x_um: Micrometre
    """Position; it increases towards the part."""
    valid: bool = False
    fault: Fault | None = None
    """Reason why there is no valid measurement."""


class ArmEstimate(FrozenRecord, frozen=True):
    """Contact force of one arm, estimated from this arm's position and voltage."""

    x_um: Micrometre
    force_mN: Millinewton
    """Force of this arm on the part; compressive forces are positive."""
    force_uncertainty_mN: Millinewton
    perturbation_mN: Millinewton
    zero_age_s: Second | None
    zero_refusal: Fault | None
    """Reason why the last request to zero the force was refused, or why its zero is no longer valid
    (``zero_invalid``)."""
    applied_V: Volt
    limits_active: Whole
    touch_x_um: Micrometre | None = None
    """Position at which an arm that should be free contacted something; None: no contact."""
    touch_mN: Millinewton | None = None
    """Lower bound of the force at the contact of ``touch_x_um``: the largest of three values. The
    first is computed from the lag of the closing arm after a change of its slope; it needs no zero.
    The second is the force minus a multiple of its uncertainty, and is negative if the arm is held
    from behind. The third, used if the zero is unconfirmed, is the force itself if it exceeds its
    uncertainty."""
    stroke_change: Number | None = None
    """Relative change of the arm's stroke since its calibration, from the last approach with
    conditioning strokes; None: not measured since the start.
    """
    stroke_limit: Number | None = None
    """Largest relative change of the stroke that noise and repeatability explain."""
    zero_unconfirmed: bool = False
    """True if a part may have pressed on the arm while the force was zeroed, so that the zero hides
    its force. This is so if the estimator knows no zero from before its start, no person has
    confirmed that the arm was free, and no part has been found at its planned place since.
    """
    force_doubt_mN: Millinewton = 0.0
    """Part of ``force_uncertainty_mN`` from a step of the position since the zero: the force that
    the step takes off the estimate if the sensor has jumped, and the uncertainty of its size. 0
    without such a step, and until the step is confirmed, by the second sample that shows it."""


class ArmCommand(FrozenRecord, frozen=True):
    """Voltage that the controller requests for one arm."""

    voltage_V: Volt
    force_mN: Millinewton | None = None
    """Force estimate of this arm that was used for the command; None without a valid zero."""
    x_d_um: Micrometre | None = None
    """Position that the law requested for this arm at sample ``seq``; None if no law controlled the
    arm.
    """


class ArmApplied(FrozenRecord, frozen=True):
    """Output of one arm after a tick."""

    voltage_V: Volt
    limits_active: Whole
    """Bits: 1 voltage at its maximum, 2 at its minimum, 4 slew limited upwards, 8 downwards."""


class ArmTelemetry(FrozenRecord, frozen=True):
    """References of one arm."""

    x_r_um: Micrometre
    x_d_um: Micrometre


class ArmTruth(FrozenRecord, frozen=True):
    """True state of one arm of a simulated rig."""

    x_um: Micrometre
    force_mN: Millinewton
    voltage_V: Volt
