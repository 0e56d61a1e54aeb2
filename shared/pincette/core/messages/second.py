"""What messages carry of the second arm, where a rig has two; each stands beside the first's."""

from pincette.control.quantities import Micrometre, Millinewton, Number, Second, Volt, Whole
from pincette.control.record import FrozenRecord
from pincette.core.faults import Fault


class SecondPosition(FrozenRecord, frozen=True):
    """Tip of the second arm, measured in the same tick."""

    x_um: Micrometre
    """Towards the part, as that of the first arm."""
    valid: bool = False
    fault: Fault | None = None
    """Why it is no measurement."""


class SecondEstimate(FrozenRecord, frozen=True):
    """Contact force of the second arm, from its own position and voltage."""

    x_um: Micrometre
    force_mN: Millinewton
    """Of this arm on the part, compressive and positive."""
    force_uncertainty_mN: Millinewton
    zero_age_s: Second | None
    zero_refusal: Fault | None
    applied_V: Volt
    limits_active: Whole
    touch_x_um: Micrometre | None = None
    touch_mN: Millinewton | None = None
    stroke_change: Number | None = None
    stroke_limit: Number | None = None
    zero_unconfirmed: bool = False


class SecondCommand(FrozenRecord, frozen=True):
    """What the controller asks of the second arm, in the same command."""

    voltage_V: Volt
    force_mN: Millinewton | None = None
    """The estimate of this arm's force; None without a valid zero."""
    x_d_um: Micrometre | None = None
    """Where the law wants this arm at the sample; None where no law has steered it there."""


class SecondApplied(FrozenRecord, frozen=True):
    """What the actuator did with the second arm; mode, cause and latch are those of both."""

    voltage_V: Volt
    limits_active: Whole


class SecondTelemetry(FrozenRecord, frozen=True):
    """The controller's view of the second arm, and of what both do to the part."""

    x_um: Micrometre
    x_r_um: Micrometre
    x_d_um: Micrometre
    force_mN: Millinewton
    voltage_V: Volt
    place_um: Micrometre
    """q = (x_1 - x_2)/2 of the sample."""
    place_r_um: Micrometre


class SecondTruth(FrozenRecord, frozen=True):
    """What only a simulated rig knows of its second arm, and of the part."""

    x_um: Micrometre
    force_mN: Millinewton
    voltage_V: Volt
    part_um: Micrometre | None = None
    """Where the first arm touches the part; None where there is no part."""
