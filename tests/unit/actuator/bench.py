"""An actuator that is armed and fed by the test, in its own time."""

from msgspec.structs import replace

from pincette.control.safety.arm import ArmLimits
from pincette.control.safety.freshness import AgeLimits
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.state import SafetyLimits
from pincette.control.safety.voltage import VoltageLimits
from pincette.core.faults import FaultCode, fault
from pincette.core.messages import Ack, Applied, Arm, Command, Message, Position, Reset
from pincette.core.messages.arms import ArmCommand, ArmPosition
from pincette.core.service import DeviceCommand
from pincette.core.wording import cause_text
from pincette_actuator.requests import handle
from pincette_actuator.state import State
from pincette_actuator.step import Inputs, start, step

T = 0.02
ARM = ArmLimits(
    VoltageLimits(min_V=-1.0, max_V=4.0, slew_V=2.0, sweep_V=0.1),
    MonitorLimits(
        period_s=T,
        force_mN=50.0,
        force_samples=3,
        following_um=10.0,
        following_s=0.1,
        following_samples=5,
        position_min_um=-29.0,
        position_max_um=79.0,
        position_samples=3,
    ),
)
CONFIG = SafetyLimits(
    period_s=T,
    lockstep=False,
    age=AgeLimits(limit_s=0.05, limit_ticks=2, grace_s=1.0, wake_s=T / 4, excused_s=10 * T),
    arms=(ARM,),
    ramp_s=0.035,
    freeze_s=0.5,
    safe_V=0.0,
)
EPOCH, OWNER = 11, 5
OFF = fault(FaultCode.INSTRUMENT_SILENT, "laser off")


def armed(config: SafetyLimits = CONFIG) -> State:
    state, _, _ = handle(config, start(config), Reset(acknowledge=True), 0.0)
    state, reply, _ = handle(config, state, Arm(EPOCH, OWNER, ""), 0.0)
    assert reply == Ack(-1)
    return state


def position(seq: int, epoch: int = EPOCH) -> Inputs:
    return Inputs(None, None, Position(epoch, seq, seq * T, (ArmPosition(1.0, valid=True),)))


def command(
    seq: int, voltage_V: float = 1.0, *, held: bool = False, epoch: int = EPOCH, owner: int = OWNER
) -> Inputs:
    return Inputs(
        None, Command(epoch, seq, owner, (ArmCommand(voltage_V),), held, False, False, True), None
    )


WAKE = Inputs(None, None, None)


def play(
    state: State, *events: tuple[Inputs, float]
) -> tuple[State, list[Message | DeviceCommand]]:
    """Feed events and store every output."""
    outputs: list[Message | DeviceCommand] = []
    for inputs, now in events:
        state, made = step(CONFIG, state, inputs, now)
        outputs += made
    return state, outputs


def with_voltages(state: State, *voltages_V: float) -> State:
    """Return the state with its arms at other voltages."""
    arms = [
        replace(arm, voltage_V=voltage_V)
        for arm, voltage_V in zip(state.arms, voltages_V, strict=True)
    ]
    return replace(state, arms=tuple(arms))


def holding(voltage_V: float = 1.0, *, held: bool) -> State:
    state, _ = play(armed(), (position(0), 0.0), (command(0, voltage_V, held=held), 0.004))
    assert state.arms[0].voltage_V == voltage_V
    return state


def wakes(start_s: float, end_s: float) -> list[tuple[Inputs, float]]:
    count = round((end_s - start_s) / (T / 4))
    return [(WAKE, start_s + index * T / 4) for index in range(count + 1)]


def cause_words(state: State | Applied) -> str:
    """Return the cause of the trip as text."""
    return cause_text(state.cause, state.faults)
