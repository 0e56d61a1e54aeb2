"""Records of one arm in messages that carry one for each arm of a rig, the first arm first."""

from pincette.control.quantities import Micrometre, Millinewton, Number, Second, Volt, Whole
from pincette.control.record import FrozenRecord
from pincette.core.faults import Fault


class ArmPosition(FrozenRecord, frozen=True):
    """Measured position of one arm's tip."""

    x_um: Micrometre
    """Position towards the part."""
    valid: bool = False
    fault: Fault | None = None
    """Why it is no measurement."""


class ArmEstimate(FrozenRecord, frozen=True):
    """Contact force of one arm, from its own position and voltage."""

    x_um: Micrometre
    force_mN: Millinewton
    """Force of this arm on the part, compressive and positive."""
    force_uncertainty_mN: Millinewton
    perturbation_mN: Millinewton
    zero_age_s: Second | None
    zero_refusal: Fault | None
    """Why the force was not zeroed when that was requested last."""
    applied_V: Volt
    limits_active: Whole
    touch_x_um: Micrometre | None = None
    """Where an arm that should be free has met something; None: nowhere."""
    touch_mN: Millinewton | None = None
    """Least force of that touch: by how far the closing arm lags since a kink in its way, which
    takes no zero, or the force less three uncertainties, below 0 where it is held from behind; by
    a zero that is not confirmed, the force itself where it is above its uncertainty."""
    stroke_change: Number | None = None
    """Change of the arm's stroke since its calibration, as a share, from the last way that began
    with conditioning strokes; None: not compared since the start."""
    stroke_limit: Number | None = None
    """Change up to which noise and repetition explain it."""
    zero_unconfirmed: bool = False
    """True where the zero may hide the force of a part that already pressed when it was taken: the
    estimator knows no zero from before its start, nobody has confirmed that the arm was free, and
    no part has been found at its planned place since."""


class ArmCommand(FrozenRecord, frozen=True):
    """Voltage that the controller asks of one arm."""

    voltage_V: Volt
    force_mN: Millinewton | None = None
    """Estimate of this arm's force that it was computed from; None without a valid zero."""
    x_d_um: Micrometre | None = None
    """Where the law wants this arm at sample ``seq``; None where no law has steered it there."""


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
