"""The sensor as a service: one reading, one numbered sample."""

from math import isfinite
from typing import NamedTuple

from msgspec import UNSET, UnsetType

from pincette.config import RigFile
from pincette.control.record import FrozenRecord
from pincette.core.faults import Fault, FaultCode, fault
from pincette.core.messages import Ack, Arm, Burst, Message, Position
from pincette.core.messages.second import SecondPosition
from pincette.core.service import Acquired, DeviceCommand, Input, Reading, RefusedError, Service
from pincette.core.topics import APPLIED, ARM, BURST, POSITION, STATUS, TIMING_OF
from pincette_sensor.config import SensorConfig, configure


class Inputs(NamedTuple):
    """``device`` is the instrument's reading of this tick."""

    device: Reading | None


class State(FrozenRecord, frozen=True):
    """Epoch and number of the next sample, and how many readings were no measurement."""

    epoch: int = 0
    seq: int = 0
    began_s: float | None = None
    refused: int = 0
    fault: Fault | None = None
    """Of the newest reading."""

    @property
    def findings(self) -> tuple[Fault, ...]:
        """Faults of this program that people see."""
        return () if self.fault is None else (self.fault,)


def start(_config: SensorConfig) -> State:
    """Epoch 0 is the idle loop before the first arming."""
    return State()


def _fault(config: SensorConfig, reading: Reading) -> Fault | None:
    """Why a reading is not a measurement; None where it is one."""
    if reading.fault:
        return reading.fault
    if not isfinite(reading.x_um):
        return fault(FaultCode.READING_NOT_FINITE, x_um=reading.x_um)
    if not config.minimum_um <= reading.x_um <= config.maximum_um:
        return fault(
            FaultCode.READING_OUT_OF_RANGE,
            x_um=reading.x_um,
            minimum_um=config.minimum_um,
            maximum_um=config.maximum_um,
        )
    return None


def _second(config: SensorConfig, reading: Reading) -> SecondPosition:
    """Position of the second arm; a fault that does not say whose it is gets to say so."""
    found = _fault(config, reading)
    x_um = 0.0 if found else config.direction * (reading.x_um - config.offset_um)
    if found is not None and found.number("arm") is None:
        found = found.with_values(arm=2)
    return SecondPosition(x_um, found is None, found)


def step(
    config: SensorConfig, state: State, inputs: Inputs, now: float
) -> tuple[State, tuple[Message | DeviceCommand, ...]]:
    """Number the reading; what is no measurement is sent as invalid, with its fault."""
    reading = inputs.device
    if reading is None:
        return state, ()
    began_s = now if state.began_s is None else state.began_s
    found = _fault(config, reading)
    x_um = 0.0 if found else config.direction * (reading.x_um - config.offset_um)
    second: SecondPosition | UnsetType = UNSET
    told = found
    if config.second is not None and reading.second is not None:
        second = _second(config.second, reading.second)
        told = found or second.fault
    position = Position(state.epoch, state.seq, now - began_s, x_um, found is None, found, second)
    refused = state.refused + (told is not None)
    after = State(state.epoch, state.seq + 1, began_s, refused, told)
    if reading.acquired is None:
        return after, (position,)
    return after, (position, _burst(config, state, reading.acquired))


def _burst(config: SensorConfig, state: State, acquired: Acquired) -> Burst:
    """Make positions of the arm of what was acquired; invalid where one is out of range."""
    low_um, high_um = config.minimum_um, config.maximum_um
    return Burst(
        epoch=state.epoch,
        seq=state.seq,
        rate_hz=acquired.rate_hz,
        x_um=tuple(config.direction * (x_um - config.offset_um) for x_um in acquired.x_um),
        drive_V=acquired.drive_V,
        valid=all(low_um <= x_um <= high_um for x_um in acquired.x_um),
    )


def handle(
    _config: SensorConfig, state: State, request: Message, _now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    """Begin a new epoch at seq 0."""
    if not isinstance(request, Arm):
        raise RefusedError(f"the sensor does not answer {type(request).__name__}")
    return State(request.epoch, 0, None, state.refused, state.fault), Ack(0), ()


SERVICE: Service[RigFile, SensorConfig, State, Inputs] = Service(
    name="sensor",
    summary="owns the sampling clock, numbers the samples, refuses what is no measurement",
    inputs=(Input(APPLIED, "pace"),),
    outputs=(POSITION, BURST),
    requests=(ARM["sensor"], STATUS["sensor"], TIMING_OF["sensor"]),
    inputs_type=Inputs,
    configure=configure,
    start=start,
    step=step,
    handle=handle,
    instrument="position_sensor",
)
