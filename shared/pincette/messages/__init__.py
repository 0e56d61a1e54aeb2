"""What travels between programs: frozen data, units in the field names.

A sample keeps its number: everything derived from sample k carries ``seq`` k, and the ``epoch``
of the arming it belongs to. A message is invalid until somebody says that it is valid.
"""

from pincette.control.safety.voltage import SLEW_DOWN, SLEW_UP, VOLTAGE_MAX, VOLTAGE_MIN
from pincette.messages.questions import (
    Act,
    Arm,
    Asked,
    Document,
    Done,
    Finish,
    Lease,
    Load,
    Order,
    Record,
    Recorded,
    Reset,
    RigFileRequest,
    RigFileTold,
    Status,
    StatusRequest,
    TimingRequest,
    Trip,
)
from pincette.messages.samples import (
    Applied,
    Burst,
    Command,
    Estimate,
    JobNotice,
    Position,
    Telemetry,
    Timing,
    Truth,
)

Message = (
    Position
    | Burst
    | Estimate
    | Command
    | Applied
    | Telemetry
    | Truth
    | JobNotice
    | Timing
    | Asked
    | Arm
    | Load
    | Act
    | Lease
    | Trip
    | Reset
    | Order
    | Record
    | Finish
    | Recorded
    | StatusRequest
    | Status
    | TimingRequest
    | RigFileRequest
    | RigFileTold
    | Done
)
Sample = Position | Burst | Estimate | Command | Applied | Telemetry

__all__ = [
    "SLEW_DOWN",
    "SLEW_UP",
    "VOLTAGE_MAX",
    "VOLTAGE_MIN",
    "Act",
    "Applied",
    "Arm",
    "Asked",
    "Burst",
    "Command",
    "Document",
    "Done",
    "Estimate",
    "Finish",
    "JobNotice",
    "Lease",
    "Load",
    "Message",
    "Order",
    "Position",
    "Record",
    "Recorded",
    "Reset",
    "RigFileRequest",
    "RigFileTold",
    "Sample",
    "Status",
    "StatusRequest",
    "Telemetry",
    "Timing",
    "TimingRequest",
    "Trip",
    "Truth",
]
