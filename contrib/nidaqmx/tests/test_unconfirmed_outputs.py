"""An NI-DAQmx analog output with an unconfirmed voltage never jumps.

The cases of the core's drivers are in tests/integration/faults. An analog output cannot be read
back and does not report a loss of its supply, so only two of their four faults apply.
"""

import pytest

from contrib.support.wired_rig import OUTPUT, WIRED, HandRig
from pincette_nidaqmx.simulated.daq import SimulatedDaq
from pincette_nidaqmx.voltage_output import open_output
from tests.integration.faults.test_unconfirmed_outputs import (
    OTHERS,
    SEEDS,
    SEEDS_IN_FULL,
    Fate,
    Wired,
    check,
    check_without_a_fault,
    demo_rig_file,
)

NAME = "nidaqmx"
FATES: tuple[Fate, ...] = ("write lost", "answer lost")


def wire(wired: Wired) -> None:
    rig = HandRig()
    rig.put_out = wired.put
    settings = demo_rig_file().output.model_copy(
        update={"driver": NAME, "url": f"ni:{OUTPUT}", "options": {}}
    )
    wired.instrument = SimulatedDaq(rig, WIRED, lockstep=True)
    wired.output = open_output(settings, wired.connect(lambda _link: None))


OTHERS[NAME] = wire


@pytest.mark.parametrize("fate", FATES)
def test_an_output_with_an_unconfirmed_voltage_never_jumps(fate: Fate) -> None:
    for seed in range(SEEDS):
        check(NAME, fate, seed)


@pytest.mark.full
@pytest.mark.parametrize("fate", FATES)
def test_an_output_with_an_unconfirmed_voltage_never_jumps_in_many_cases(fate: Fate) -> None:
    for seed in range(SEEDS, SEEDS_IN_FULL):
        check(NAME, fate, seed)


def test_without_a_fault_there_is_no_read_back_and_no_trip() -> None:
    check_without_a_fault(NAME)
