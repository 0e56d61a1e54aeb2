"""All metrics, with their labels and meanings."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["counter", "gauge", "histogram"]


@dataclass(frozen=True, slots=True)
class Family:
    """One metric."""

    name: str
    """As Prometheus stores it, with base units: seconds and newtons."""
    kind: Kind
    labels: tuple[str, ...]
    meaning: str
    where: str = ""
    """Where it is served, if not everywhere."""


REAL_TIME = "in real time"
BUILD = Family("pincette_build_info", "gauge", ("version",), "1; the supervisor's version")
UP = Family(
    "pincette_service_up",
    "gauge",
    ("rig", "service"),
    "1 where a program's token is seen and it has answered when it was last asked",
)
UNUSABLE = Family("pincette_rigs_unusable", "gauge", (), "rigs that were found and are not served")
LEFT_OUT = Family("pincette_rigs_left_out", "gauge", (), "rigs served beyond those told of here")
LATCHED = Family(
    "pincette_latched", "gauge", ("rig",), "1 where a person must reset the rig before it moves"
)
HEARD = Family(
    "pincette_actuator_heard_age_seconds",
    "gauge",
    ("rig",),
    "since the actuator was heard; NaN where it never was",
)
PART = Family(
    "pincette_part",
    "gauge",
    ("rig", "part", "certainty"),
    "1 for what is told of the part, and how far it can be trusted; 0 for all else",
)
STROKE = Family(
    "pincette_stroke_change_ratio",
    "gauge",
    ("rig",),
    "change of the first arm's stroke since its calibration; NaN where it was not compared",
)
TRIPS = Family("pincette_trips_total", "counter", ("rig", "cause"), "trips of the actuator")
LATENESS = Family(
    "pincette_lateness_seconds",
    "histogram",
    ("rig", "service"),
    "sensor, actuator: wake-ups against their own grid; estimator, controller: arrival of their "
    "samples",
    REAL_TIME,
)
AGE = Family(
    "pincette_tick_age_seconds",
    "histogram",
    ("rig", "service"),
    "from the first arrival of a sample's number to the step with what the program acts on",
    REAL_TIME,
)
EXECUTION = Family(
    "pincette_execution_seconds",
    "histogram",
    ("rig", "service"),
    "of a step until all was told, instruments included",
    REAL_TIME,
)
COMMAND_AGE = Family(
    "pincette_command_age_seconds",
    "histogram",
    ("rig",),
    "age of the commands that the actuator took; its limit trips the rig",
)
MISSED = Family(
    "pincette_missed_ticks_total",
    "counter",
    ("rig", "service"),
    "samples and points of the grid that a program has skipped",
    REAL_TIME,
)
UNANSWERED = Family(
    "pincette_unanswered_ticks_total",
    "counter",
    ("rig",),
    "ticks of an armed actuator without a command that it took",
)
DEGRADED = Family(
    "pincette_degraded_estimates_total",
    "counter",
    ("rig",),
    "estimates made without the voltage of the sample before",
)
DROPPED = Family(
    "pincette_dropped_total",
    "counter",
    ("rig", "service", "kind"),
    "`gap`: numbers that lacked between two samples of an armed loop, as the supervisor heard "
    "them; `refused`: messages and commands that the program refused; `record`: messages that "
    "the records lack",
)
INSTRUMENT = Family(
    "pincette_instrument_exchanges_total",
    "counter",
    ("rig", "service", "kind"),
    "exchanges with instruments that went wrong. `late`: answers that came after their timeout, "
    "and were dropped; `lost`: answers that never came; `unexpected`: answers more than requests; "
    "`reopened`: ports opened again; `retried`: attempts repeated when an instrument was opened",
)
EXCHANGES = Family(
    "pincette_instrument_exchange_seconds",
    "gauge",
    ("rig", "service", "arm", "statistic"),
    "`minimum`, `median` and `worst` duration of the newest 40 exchanges with an instrument that "
    "succeeded: readings of the sensor's program, writes and questions of the actuator's",
)
GONE = Family(
    "pincette_programs_gone_total",
    "counter",
    ("rig", "service"),
    "times that a program was no longer seen on the bus: it ended, or a link on the way did; each "
    "program logs its own links",
)
PEAK = Family(
    "pincette_force_peak_newtons",
    "gauge",
    ("rig",),
    "highest estimated contact force of the newest arming that had any",
)
PEAKS = Family(
    "pincette_arming_force_peak_newtons",
    "histogram",
    ("rig",),
    "the same of every arming that is over, so that none is missed between two scrapes",
)
ZERO_RETURNS = Family(
    "pincette_zero_returns_total",
    "counter",
    ("rig", "verified"),
    "jobs whose arm came back free to the place of its zero; `false` where the force read there "
    "was beyond its uncertainty",
)
JOBS = Family("pincette_jobs", "gauge", ("rig", "kind", "state"), "jobs in the journal")
QUEUE_HALTED = Family(
    "pincette_queue_halted", "gauge", ("rig",), "1 where the queue waits for a person"
)
SUPERVISOR = Family(
    "pincette_supervisor_seconds_total",
    "counter",
    ("share",),
    "where the supervisor's time goes: `stood`, nothing of it ran; `bus`, messages; `journal`, "
    "writes; `drawing`; the shares overlap",
)
FAMILIES = [value for value in list(globals().values()) if isinstance(value, Family)]
