"""Records of one arm in messages that carry one for each arm of a rig, the first arm first."""

from pincette.control.quantities import Micrometre, Millinewton, Number, Second, Volt, Whole
from pincette.control.record import FrozenRecord
from pincette.core.faults import Fault

ARM_PREFIXES = ("", "second.")
"""Beginning of the names of each arm's quantities, in tables, rig files and faults."""


class ArmPosition(FrozenRecord, frozen=True):
    """Measured position of one arm's tip."""

    x_um: Micrometre
    """Position towards the part."""
    valid: bool = False
    fault: Fault | None = None
    """Reason why there is no valid measurement."""


class ArmEstimate(FrozenRecord, frozen=True):
    """Contact force of one arm, estimated from its own position and voltage."""

    x_um: Micrometre
    force_mN: Millinewton
    """Force of this arm on the part, compressive and positive."""
    force_uncertainty_mN: Millinewton
    perturbation_mN: Millinewton
    zero_age_s: Second | None
    zero_refusal: Fault | None
    """Reason why the last requested zero was refused."""
    applied_V: Volt
    limits_active: Whole
    touch_x_um: Micrometre | None = None
    """Position at which an arm that should be free met something; None: it met nothing."""
    touch_mN: Millinewton | None = None
    """Smallest force of that touch: from the lag of the closing arm since a kink in its way, which
    needs no zero, or the force less three uncertainties, negative if the arm is held from behind;
    with an unconfirmed zero, the force itself if it exceeds its uncertainty."""
    stroke_change: Number | None = None
    """Change of the arm's stroke since its calibration, as a share, from the last way that began
    with conditioning strokes; None: not compared since the start."""
    stroke_limit: Number | None = None
    """Largest change of the stroke that noise and repetition explain, as a share."""
    zero_unconfirmed: bool = False
    """True if the zero may hide the force of a part that already pressed when it was taken: the
    estimator knows no zero from before its start, no one has confirmed that the arm was free, and
    no part has been found at its planned place since."""


class ArmCommand(FrozenRecord, frozen=True):
    """Voltage that the controller requests for one arm."""

    voltage_V: Volt
    force_mN: Millinewton | None = None
    """Estimated force of this arm from which the command was computed; None without a valid zero.
    """
    x_d_um: Micrometre | None = None
    """Position that the law requested for this arm at sample ``seq``; None if no law controlled it
    there."""


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
