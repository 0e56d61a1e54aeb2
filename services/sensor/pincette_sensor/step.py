"""The sensor as a service: one reading, one numbered sample."""

from math import isfinite

from msgspec.structs import replace

from pincette.config import RigFile
from pincette.control.record import FrozenRecord
from pincette.core.faults import Fault, FaultCode, fault
from pincette.core.idle_sampling import idle_periods
from pincette.core.messages import Ack, Arm, Burst, Idle, Message, Position
from pincette.core.messages.arms import ArmPosition
from pincette.core.service import (
    Acquired,
    ArmReading,
    DeviceCommand,
    Input,
    Reading,
    RefusedError,
    Service,
)
from pincette.core.topics import APPLIED, ARM, BURST, IDLE, POSITION, STATUS, TIMING_OF
from pincette_sensor.config import ArmSensor, SensorConfig, configure


class Inputs(FrozenRecord, frozen=True):
    """Inputs of a step.

    ``device`` is the instrument's reading of this tick.
    """

    device: Reading | None


class State(FrozenRecord, frozen=True):
    """Epoch and number of the next sample, and the number of invalid readings."""

    epoch: int = 0
    seq: int = 0
    began_s: float | None = None
    refused: int = 0
    fault: Fault | None = None
    """Fault of the newest reading; None if it was valid."""
    idle: bool = False
    """True from an ``Idle`` request to the next arming: samples are taken seldom."""
    stride: int = 1
    """Number of control periods from the newest sample to the next one; the sample number grows
    by as many."""

    @property
    def findings(self) -> tuple[Fault, ...]:
        """Faults of this program that are reported."""
        return () if self.fault is None else (self.fault,)


def start(_config: SensorConfig) -> State:
    """Return the state of the idle loop before the first arming, epoch 0."""
    return State()


def _measured(config: ArmSensor, reading: ArmReading, arm: int) -> ArmPosition:
    """Return one arm's position, or the fault of an invalid reading.

    Parameters
    ----------
    arm
        Index of the arm, from 0. A fault of the second arm also contains the number of the arm.
    """
    found = _fault(config, reading)
    if found is None:
        return ArmPosition(config.position_um(reading.x_um), valid=True)
    if arm and found.number("arm") is None:
        found = found.with_values(arm=arm + 1)
    return ArmPosition(0.0, valid=False, fault=found)


def _fault(config: ArmSensor, reading: ArmReading) -> Fault | None:
    """Return the fault of an invalid reading; None if it is valid."""
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


def step(
    config: SensorConfig, state: State, inputs: Inputs, now: float
) -> tuple[State, tuple[Message | DeviceCommand, ...]]:
    """Send a numbered sample with the reading, or with the fault of an invalid reading."""
    reading = inputs.device
    if reading is None:
        return state, ()
    began_s = now if state.began_s is None else state.began_s
    arms: list[ArmPosition] = []
    found = None
    for arm, (own, one) in enumerate(zip(config.arms, reading.arms, strict=True)):
        measured = _measured(own, one, arm)
        found = found or measured.fault
        arms.append(measured)
    position = Position(state.epoch, state.seq, now - began_s, tuple(arms))
    refused = state.refused + (found is not None)
    stride = idle_periods(config.period_s) if state.idle else 1
    after = State(state.epoch, state.seq + stride, began_s, refused, found, state.idle, stride)
    acquired = reading.arms[0].acquired
    if acquired is None:
        return after, (position,)
    return after, (position, _burst(config.arms[0], state, acquired))


def _burst(config: ArmSensor, state: State, acquired: Acquired) -> Burst:
    """Convert an acquisition to positions of the arm; invalid if one is out of range."""
    low_um, high_um = config.minimum_um, config.maximum_um
    return Burst(
        epoch=state.epoch,
        seq=state.seq,
        rate_hz=acquired.rate_hz,
        x_um=tuple(config.position_um(x_um) for x_um in acquired.x_um),
        drive_V=acquired.drive_V,
        valid=all(low_um <= x_um <= high_um for x_um in acquired.x_um),
    )


def handle(
    _config: SensorConfig, state: State, request: Message, _now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    """Begin a new epoch at seq 0, or reduce the sampling rate because the epoch is over."""
    if isinstance(request, Idle):
        if request.epoch != state.epoch:
            raise RefusedError(
                f"the sensor is in epoch {state.epoch}, not {request.epoch}: ask for its status, "
                "and repeat the request for that epoch if it is over"
            )
        return replace(state, idle=True), Ack(state.seq), ()
    if not isinstance(request, Arm):
        raise RefusedError(f"the sensor does not answer {type(request).__name__}")
    return State(request.epoch, 0, None, state.refused, state.fault), Ack(0), ()


def _timer_s(config: SensorConfig, state: State) -> float:
    return state.stride * config.period_s


SERVICE: Service[RigFile, SensorConfig, State, Inputs] = Service(
    name="sensor",
    summary="owns the sampling clock, numbers the samples, refuses invalid measurements",
    inputs=(Input(APPLIED, "pace"),),
    outputs=(POSITION, BURST),
    requests=(ARM["sensor"], IDLE, STATUS["sensor"], TIMING_OF["sensor"]),
    inputs_type=Inputs,
    configure=configure,
    start=start,
    step=step,
    handle=handle,
    instrument="position_sensor",
    timer_s=_timer_s,
)
