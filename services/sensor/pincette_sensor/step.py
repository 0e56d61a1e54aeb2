"""The sensor as a service: one reading, one numbered sample."""

from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

from pincette.config import RigFile
from pincette.messages import Arm, Burst, Done, Message, Position
from pincette.service import Acquired, ForInstrument, Input, Reading, RefusedError, Service
from pincette.topics import APPLIED, ARM, BURST, POSITION, STATUS, TIMING_OF
from pincette_sensor.config import SensorConfig, configure


class Inputs(NamedTuple):
    """``device`` is the instrument's reading of this tick."""

    device: Reading | None


@dataclass(frozen=True, slots=True)
class State:
    """Epoch and number of the next sample, and how many readings were no measurement."""

    epoch: int = 0
    seq: int = 0
    began_s: float | None = None
    refused: int = 0
    detail: str = ""


def start(_config: SensorConfig) -> State:
    """Epoch 0 is the idle loop before the first arming."""
    return State()


def _fault(config: SensorConfig, reading: Reading) -> str:
    """Why a reading is not a measurement; empty where it is one."""
    if reading.fault:
        return reading.fault
    if not isfinite(reading.x_um):
        return f"position {reading.x_um} µm is not a number"
    if not config.minimum_um <= reading.x_um <= config.maximum_um:
        return (
            f"position {reading.x_um:.3f} µm is outside the sensor's range "
            f"{config.minimum_um:g}..{config.maximum_um:g} µm"
        )
    return ""


def step(
    config: SensorConfig, state: State, inputs: Inputs, now: float
) -> tuple[State, tuple[Message | ForInstrument, ...]]:
    """Number the reading; what is no measurement is sent as invalid, with its fault."""
    reading = inputs.device
    if reading is None:
        return state, ()
    began_s = now if state.began_s is None else state.began_s
    fault = _fault(config, reading)
    x_um = 0.0 if fault else config.direction * (reading.x_um - config.offset_um)
    position = Position(state.epoch, state.seq, now - began_s, x_um, not fault, fault[:200])
    refused = state.refused + bool(fault)
    after = State(state.epoch, state.seq + 1, began_s, refused, fault)
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


def answer(
    _config: SensorConfig, state: State, request: Message, _now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    """Begin a new epoch at seq 0."""
    if not isinstance(request, Arm):
        raise RefusedError(f"the sensor does not answer {type(request).__name__}")
    return State(request.epoch, 0, None, state.refused, state.detail), Done(0), ()


SERVICE: Service[RigFile, SensorConfig, State, Inputs] = Service(
    name="sensor",
    summary="owns the sampling clock, numbers the samples, refuses what is no measurement",
    inputs=(Input(APPLIED, "pace"),),
    outputs=(POSITION, BURST),
    questions=(ARM["sensor"], STATUS["sensor"], TIMING_OF["sensor"]),
    inputs_type=Inputs,
    configure=configure,
    start=start,
    step=step,
    answer=answer,
    instrument="position_sensor",
)
