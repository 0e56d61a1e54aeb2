"""The hard limits once more, before a command leaves: the actuator's own rules, here.

The guards end a program gently; where what they did is not enough, or the law has gone astray, the
controller commands no more. Its command of that sample is invalid, says why, and carries what is
known of the sample: by that the actuator finds the same, and trips. Were it deaf to that, its age
limit would act, since no valid command follows.
"""

from pincette.control.replacing import replace
from pincette.control.safety.admission import nonsense
from pincette.control.safety.monitors import (
    MonitorLimits,
    Watches,
    finding,
    watch_command,
    watch_position,
)
from pincette.control.safety.voltage import VoltageLimits
from pincette.messages import Command, Estimate


def mirrored(
    monitors: MonitorLimits,
    voltage: VoltageLimits,
    watches: Watches,
    command: Command,
    estimate: Estimate,
) -> tuple[Watches, Command]:
    """A command as it may leave; one that is refused keeps the voltage that is applied."""
    numbers = (command.voltage_V, command.force_mN, command.x_d_um)
    if why := nonsense(voltage, *numbers):
        return watches, refused(command, estimate, f"the law: {why}", known=False)
    watches = watch_command(
        monitors,
        watch_position(monitors, watches, estimate.x_um),
        seq=command.seq,
        x_um=estimate.x_um,
        x_d_um=command.x_d_um,
        force_mN=command.force_mN,
    )
    why = finding(monitors, watches)
    return watches, refused(command, estimate, why, known=True) if why else command


def refused(command: Command, estimate: Estimate, why: str, *, known: bool) -> Command:
    """A command that keeps the voltage that is applied; ``known``: whether the numbers that it
    knows of its sample can be told."""
    return replace(
        command,
        voltage_V=estimate.applied_V,
        zero=False,
        final=False,
        valid=False,
        fault=why,
        sweep=None,
        force_mN=command.force_mN if known else None,
        x_d_um=command.x_d_um if known else None,
    )
