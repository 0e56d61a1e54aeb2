"""Codes, choices and limits of control that REST uses too.

It needs only the standard library, like the distribution ``pincette-client``.
"""

from collections.abc import Mapping
from enum import StrEnum, auto
from typing import Literal

ParameterSet = Literal["consistent", "printed", "identified"]
ReleaseStrategy = Literal["retreat", "fast", "dither", "wait"]
ForceAge = Literal["planned", "newest"]
LimitedQuantity = Literal[
    "force",
    "position",
    "voltage",
    "taught_voltage",
    "slew",
    "rate",
    "acceleration",
    "frequency",
    "speed",
    "duration",
    "sweep_amplitude",
    "spectral_radius",
    "sensitivity_peak",
]
"""Quantities whose limit a plan or a prediction can exceed."""

LARGEST: Mapping[str, float] = {
    "µm": 1e9,
    "mN": 1e12,
    "V": 1e6,
    "s": 1e12,
    "Hz": 1e9,
    "%": 1e6,
    "µm/s": 1e12,
    "µm/s²": 1e15,
    "mN/s": 1e15,
    "V/s": 1e12,
    "rad/s": 1e12,
    "mN/µm": 1e12,
    "µm/mN": 1e9,
    "µm/V": 1e9,
    "": 1e15,
}
"""Largest magnitude of a number by unit; the empty unit is for gains and fractions."""


class FaultCode(StrEnum):
    """All faults that a program can detect; ``core.wording`` has a text for each."""

    # Instruments, by the cause of the driver's error, whose words are added.
    INSTRUMENT_CANNOT_OPEN = auto()
    INSTRUMENT_HUNG_UP = auto()
    INSTRUMENT_SILENT = auto()
    INSTRUMENT_LATE = auto()
    INSTRUMENT_GARBLED = auto()
    INSTRUMENT_REFUSED = auto()
    INSTRUMENT_OUT_OF_RANGE = auto()
    INSTRUMENT_INVALID = auto()
    INSTRUMENT_TRIPPED = auto()
    INSTRUMENT_MISUSED = auto()
    # The sensor.
    NO_ACQUISITION = auto()
    READING_NOT_FINITE = auto()
    READING_OUT_OF_RANGE = auto()
    # The estimator.
    POSITION_OUT_OF_RANGE = auto()
    SENSOR_STUCK = auto()
    MEMORY_UNKNOWN = auto()
    MODEL_MISMATCH = auto()
    NO_APPLIED_VOLTAGE = auto()
    FORCES_DISAGREE = auto()
    ZERO_PART_HELD = auto()
    ZERO_TOO_FEW_SAMPLES = auto()
    ZERO_NOT_SETTLED = auto()
    ZERO_BEYOND_FIRST_TOUCH = auto()
    ZERO_TOUCHED = auto()
    ZERO_OFFSET = auto()
    ZERO_FIRST_OFFSET = auto()
    ZERO_INVALID = auto()
    # Commands, found by controller and actuator.
    VOLTAGE_NOT_FINITE = auto()
    VOLTAGE_ABSURD = auto()
    FORCE_NOT_FINITE = auto()
    TARGET_NOT_FINITE = auto()
    OTHER_EPOCH = auto()
    OTHER_OWNER = auto()
    COMMAND_AHEAD = auto()
    OTHER_ARMS = auto()
    COMMAND_REPEATED = auto()
    SAMPLE_NOT_SEEN = auto()
    COMMAND_TOO_LATE = auto()
    COMMAND_SAMPLES_TOO_OLD = auto()
    NOT_ARMED = auto()
    SWEEP_TOO_WIDE = auto()
    SWEEP_OUT_OF_RANGE = auto()
    # Hard limits, found by controller and actuator.
    FORCE_BEYOND_LIMIT = auto()
    FOLLOWING_BEYOND_LIMIT = auto()
    POSITION_BEYOND_LIMITS = auto()
    # The actuator.
    NO_COMMAND = auto()
    FREEZE_RELEASED = auto()
    OUTPUT_UNCONFIRMED = auto()
    REQUESTED = auto()
    SECOND_CONTROLLER = auto()
    STANDSTILLS = auto()
    SUSPENDED = auto()
    EXCHANGE_TIMES = auto()
    # The controller.
    LAW_NUMBER = auto()
    ACTUATOR_TRIPPED = auto()
    LEASE_ENDED = auto()
    # The recorder.
    RECORDER_STATE = auto()
    RECORD_TROUBLE = auto()
    CLOCK_STEPPED = auto()
    RECORD_BEHIND = auto()
    RECORD_DAMAGED = auto()
    # Any program.
    MESSAGES_REFUSED = auto()
