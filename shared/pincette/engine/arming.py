"""Arms a rig: every service of the loop begins the same epoch, the sensor last."""

from typing import cast

from pincette.bus.protocol import Bus
from pincette.control.planning.program import Program
from pincette.control.quantities import Document
from pincette.core.messages import Arm, Lease, Load, Status, StatusRequest
from pincette.core.topics import ARM, LEASE, LOAD, STATUS

ORDER = ("actuator", "estimator", "controller", "sensor")
"""Order of arming. The actuator is first: if it refuses, nothing else has changed. The sensor is
last: in lockstep its arming is the first tick.
"""


def status(bus: Bus, service: str, timeout_s: float = 2.0) -> Status:
    """Return the status of a service; raises BusError if it does not reply."""
    return cast(Status, bus.call(STATUS[service], StatusRequest(), timeout_s))


def arm(
    bus: Bus,
    program: Program,
    *,
    epoch: int,
    digest: str,
    owner: int | None = None,
    calibration: str = "",
    lease: Lease | None = None,
    zero_confirmed: bool = False,
) -> None:
    """Load a program and start it.

    Parameters
    ----------
    zero_confirmed
        True if a person has confirmed that nothing touches the arm; a new zero is then not compared
        with earlier ones.

    Raises
    ------
    BusError, RefusalError
        A service does not reply, or refuses.
    """
    if owner is None:
        owner = status(bus, "controller").instance
    bus.call(LOAD, Load(program))
    planned = program.planned_range
    for service in ORDER:
        request = Arm(
            epoch,
            owner,
            digest,
            Document(calibration),
            program.capture_hz,
            zero_confirmed,
            () if planned is None else planned.voltages,
            program.takes_force_over,
        )
        bus.call(ARM[service], request)
        # Before the first sample, so that no program plays without its lease.
        if service == "controller" and lease is not None:
            bus.call(LEASE, lease)
