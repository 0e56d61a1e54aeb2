"""Messages between programs: frozen data, with units in the field names.

Every message derived from sample k contains ``seq`` k and the ``epoch`` of its arming. A message is
invalid until its producer marks it valid.
"""

from pincette.core.messages.requests import (
    Ack,
    Action,
    Arm,
    Finish,
    Idle,
    Lease,
    Load,
    Record,
    Recorded,
    RequestLog,
    Reset,
    RigFileReply,
    RigFileRequest,
    SimCommand,
    Status,
    StatusRequest,
    TimingRequest,
    Trip,
)
from pincette.core.messages.samples import (
    Applied,
    Burst,
    Command,
    Estimate,
    GroundTruth,
    JobNotice,
    Place,
    Position,
    Telemetry,
    Timing,
)

Message = (
    Position
    | Burst
    | Estimate
    | Command
    | Applied
    | Telemetry
    | GroundTruth
    | JobNotice
    | Place
    | Timing
    | RequestLog
    | Arm
    | Load
    | Action
    | Lease
    | Idle
    | Trip
    | Reset
    | SimCommand
    | Record
    | Finish
    | Recorded
    | StatusRequest
    | Status
    | TimingRequest
    | RigFileRequest
    | RigFileReply
    | Ack
)
Sample = Position | Burst | Estimate | Command | Applied | Telemetry
