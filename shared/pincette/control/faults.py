"""What is wrong, as a code and numbers: programs compare codes, people read ``core.wording``."""

from enum import StrEnum, auto
from math import isfinite

from pincette.control.quantities import LARGEST, MAX_TEXT, Items, Number, Text
from pincette.control.record import FrozenRecord


class FaultCode(StrEnum):
    """Everything that a program can find wrong; ``core.wording`` has a text for each."""

    # An instrument, by the cause of its driver's error, whose words go with it.
    INSTRUMENT_CANNOT_OPEN = auto()
    INSTRUMENT_HUNG_UP = auto()
    INSTRUMENT_SILENT = auto()
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
    NO_APPLIED_VOLTAGE = auto()
    ZERO_PART_HELD = auto()
    ZERO_TOO_FEW_SAMPLES = auto()
    ZERO_NOT_SETTLED = auto()
    ZERO_BEYOND_FIRST_TOUCH = auto()
    ZERO_TOUCHED = auto()
    ZERO_OFFSET = auto()
    ZERO_FIRST_OFFSET = auto()
    # A command, by controller and actuator.
    VOLTAGE_NOT_FINITE = auto()
    VOLTAGE_ABSURD = auto()
    FORCE_NOT_FINITE = auto()
    TARGET_NOT_FINITE = auto()
    OTHER_EPOCH = auto()
    OTHER_OWNER = auto()
    COMMAND_AHEAD = auto()
    COMMAND_REPEATED = auto()
    SAMPLE_NOT_SEEN = auto()
    COMMAND_TOO_LATE = auto()
    COMMAND_SAMPLES_TOO_OLD = auto()
    NOT_ARMED = auto()
    SWEEP_TOO_WIDE = auto()
    SWEEP_OUT_OF_RANGE = auto()
    # A hard limit, by controller and actuator.
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
    # The controller.
    LAW_NUMBER = auto()
    ACTUATOR_TRIPPED = auto()
    LEASE_ENDED = auto()
    # The recorder.
    RECORDER_STATE = auto()
    RECORD_TROUBLE = auto()


ZERO_REFUSED = frozenset(code for code in FaultCode if code.name.startswith("ZERO_"))
"""Why the force is not zeroed."""
INSTRUMENT = frozenset(code for code in FaultCode if code.name.startswith("INSTRUMENT_"))
"""What a driver reports of its instrument."""


class Value(FrozenRecord, frozen=True):
    """A number by its name, which ends in its unit; None where it is not finite."""

    name: Text
    value: Number | None


class Fault(FrozenRecord, frozen=True):
    """What is wrong: a code, its numbers, and words only where they come from outside."""

    code: FaultCode
    values: Items[Value] = ()
    words: Text = ""
    """Of a driver or a person; no program reads them."""

    def number(self, name: str) -> float | None:
        """The value of this name; None where it is not finite, or there is none."""
        return next((item.value for item in self.values if item.name == name), None)

    def with_values(self, **values: float) -> "Fault":
        """This fault with more numbers."""
        return Fault(self.code, self.values + _values(values), self.words)


def fault(code: FaultCode, words: str = "", /, **values: float) -> Fault:
    """A fault with numbers by name; those beyond 1e15 become 1e15."""
    return Fault(code, _values(values), words[:MAX_TEXT])


def _values(values: dict[str, float]) -> tuple[Value, ...]:
    return tuple(Value(name, _carried(value)) for name, value in values.items())


def _carried(value: float) -> float | None:
    most = LARGEST[""]
    return min(max(float(value), -most), most) if isfinite(value) else None
