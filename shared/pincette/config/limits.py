"""Limits of a rig, and the reaction of the actuator to a fault."""

from pydantic import Field, model_validator

from pincette.config.tables import NotNegative, Positive, Table


class Limits(Table):
    """Limits of the rig. The actuator enforces the voltage limits, the supervisor all limits."""

    voltage_min_V: float
    """Lowest voltage at the amplifier's input."""
    voltage_max_V: float
    """Highest voltage at the amplifier's input."""
    slew_V_per_s: Positive
    """Highest rate of change of the voltage, for every command."""
    sweep_V: Positive = 0.1
    """Largest amplitude of a swept sine. Near the resonance the arm moves 1/(2ζ) times as far as at
    low frequency."""
    position_min_um: float
    """Lowest position that a job may plan or reach."""
    position_max_um: float
    """Highest position that a job may plan or reach."""
    force_max_mN: Positive
    """Highest force that a job may plan or reach."""

    @model_validator(mode="after")
    def _ordered(self) -> "Limits":
        if self.voltage_min_V >= self.voltage_max_V:
            raise ValueError(
                f"voltage_min_V = {self.voltage_min_V} V is not below "
                f"voltage_max_V = {self.voltage_max_V} V"
            )
        if self.position_min_um >= self.position_max_um:
            raise ValueError(
                f"position_min_um = {self.position_min_um} µm is not below "
                f"position_max_um = {self.position_max_um} µm"
            )
        return self


class Safety(Table):
    """Reaction of the actuator to faults, and the thresholds of these faults."""

    command_age_periods: float = Field(default=2.5, ge=1.5, le=10)
    """Age at which a command is too old. The actuator trips if no newer command arrives by then."""
    ramp_s: float = Field(default=0.035, ge=0.005, le=2.0)
    """Duration of the ramp from the voltage at a trip to the safe voltage, if no part is held."""
    safe_V: float = 0.0
    """Voltage at which the arm is free and at rest."""
    freeze_s: float = Field(default=10.0, ge=0.0, le=600.0)
    """Time for which a voltage frozen after a fault holds a part before the ramp releases it."""
    force_factor: float = Field(default=1.25, ge=1.05, le=3.0)
    """Factor of ``limits.force_max_mN``. If the estimated force exceeds ``force_max_mN``, the guard
    of the controller ends the program gently. If it exceeds ``force_factor`` times
    ``force_max_mN``, the actuator releases the part, whatever the command.
    """
    force_samples: int = Field(default=3, ge=1, le=50)
    """Number of successive samples with a force above ``force_factor`` times ``force_max_mN``
    before the actuator trips; the guard needs this time to act."""
    following_um: Positive = 3.0
    """Largest distance of the arm from the law's desired position while the desired position rests.
    """
    following_s: NotNegative = 0.05
    """Additional permitted distance for each µm/s of speed of the desired position, up to the speed
    of the arm at the slew limit.
    """
    following_for_s: float = Field(default=0.12, gt=0.0, le=2.0)
    """Time for which the permitted distance may be exceeded before the actuator trips. It is
    counted in samples; each sample within the distance reduces the count by one. If a part is lost
    at ``force_max_mN``, the arm jumps by s_p·F; the slew limit corrects that in s_p·F/(d_p·slew),
    0.1 s with the demo's numbers."""
    position_margin: float = Field(default=0.1, ge=0.0, le=1.0)
    """Margin by which a measured position may lie outside ``limits.position_*``, as a fraction of
    their range.
    """
    position_samples: int = Field(default=3, ge=1, le=50)
    """Number of successive samples outside the permitted positions before the actuator trips."""
    lease_s: float = Field(default=10.0, ge=0.0, le=600.0)
    """Time without a message from the supervisor after which, in real time, the controller stops
    the program as defined by its job; 0: the program continues to its end. The default tolerates a
    slow disk, but not a supervisor that has died.
    """
