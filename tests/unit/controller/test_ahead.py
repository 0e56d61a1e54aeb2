"""What the controller works out after its command: the memory that the next sample will ask for."""

from dataclasses import replace as replaced

import pytest

from pincette.control.safety.voltage import VoltageLimits
from pincette.core.messages import Command, Estimate
from pincette.core.messages.arms import ArmCommand
from pincette_controller.step import State, ahead, start
from tests.support.arms import with_arm
from tests.unit.controller.bench import CONFIG, QUIET

STEP_V = 0.003
LIMITS = VoltageLimits(-1.0, 4.0, 0.2, 0.1, step_V=STEP_V)
STEPPED = replaced(CONFIG, arms=(replaced(CONFIG.arms[0], voltage=LIMITS),))
COMMAND = Command(
    epoch=0,
    seq=0,
    owner=1,
    arms=(ArmCommand(0.0),),
    part_held=False,
    zero=False,
    final=False,
    valid=True,
)


def told(voltage_V: float) -> State:
    """The controller's state after it has sent a command, and before the next sample."""
    return ahead(STEPPED, start(STEPPED), with_arm(COMMAND, voltage_V=voltage_V))


def sample(applied_V: float) -> Estimate:
    return with_arm(QUIET, epoch=0, seq=1, applied_V=applied_V)


@pytest.mark.parametrize(
    ("commanded_V", "applied_V"),
    [
        (0.1, round(0.1 / STEP_V) * STEP_V),
        (-0.1001, round(-0.1001 / STEP_V) * STEP_V),
        (0.9, 66 * STEP_V),  # the slew
        (-0.9, -66 * STEP_V),
    ],
)
def test_the_memory_is_led_by_what_the_actuator_puts_out(
    commanded_V: float, applied_V: float
) -> None:
    arm = told(commanded_V).memories[0]
    assert arm.follow(sample(applied_V), 0, CONFIG.period_s) is arm.expected


def test_a_voltage_that_was_put_out_otherwise_is_followed_as_if_nothing_had_been_expected() -> None:
    arm = told(0.1).memories[0]
    found = arm.follow(sample(0.006), 0, CONFIG.period_s)
    assert found is not arm.expected
    assert found == start(STEPPED).memories[0].follow(sample(0.006), 0, CONFIG.period_s)
