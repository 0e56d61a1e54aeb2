"""What ``pincette init`` asks: only what a laboratory must know of its bench."""

from dataclasses import dataclass

from pincette.cli.rig_form import Value


@dataclass(frozen=True, slots=True)
class Question:
    """Something that a laboratory must know of its bench."""

    name: str
    """Key of the template; with dashes, the option."""
    words: str
    unit: str
    default: Value
    where: str
    """Where the answer is found."""

    @property
    def flag(self) -> str:
        """The option that answers it."""
        return f"--{self.name.replace('_', '-')}"


RIG = (
    Question(
        "name", "name of the rig, in records and at the supervisor", "", "bench", "you choose it"
    ),
    Question("period_s", "time between two samples", "s", 0.02, "doctor says if it is too short"),
)
SENSOR = (
    Question("sensor_min_um", "lowest reading", "µm", -9999.0, "the measuring range of the head"),
    Question("sensor_max_um", "highest reading", "µm", 9999.0, "the measuring range of the head"),
)
ARM = (
    Question("amplifier_gain", "gain of the amplifier", "V/V", 20.0, "its name plate or manual"),
    Question(
        "arm_min_V", "lowest voltage at the arm", "V", -20.0, "data sheet of its piezo actuator"
    ),
    Question(
        "arm_max_V", "highest voltage at the arm", "V", 80.0, "data sheet of its piezo actuator"
    ),
    Question(
        "free_stroke_um",
        "free stroke of the tip over that range of voltage",
        "µm",
        95.0,
        "data sheet of the arm; within 20 % is enough, `free_response` measures it",
    ),
    Question(
        "compliance_um_per_mN",
        "how far a force at the tip bends the arm",
        "µm/mN",
        0.46,
        "free stroke over blocking force; `compliance` measures it",
    ),
    Question(
        "position_min_um", "lowest position of the tip", "µm", -30.0, "free way; at 0 V it is 0"
    ),
    Question(
        "position_max_um", "highest position of the tip", "µm", 90.0, "the free way of the arm"
    ),
    Question("force_max_mN", "highest force", "mN", 40.0, "what the weaker of arm and part bears"),
)
PART = (
    Question("part_name", "the part", "", "glass bead 1400 µm", "a description for people"),
    Question(
        "contact_um",
        "where the arm touches the part first",
        "µm",
        30.0,
        "the gap, seen in the microscope; `contact_stiffness` measures it",
    ),
    Question(
        "contact_tolerance_um", "how far off that may be", "µm", 3.0, "how well the part is placed"
    ),
    Question(
        "stiffness_mN_per_um",
        "stiffness of the part, in series with the passive arm",
        "mN/µm",
        2.17,
        "of the passive arm if the part is harder; `contact_stiffness` measures it",
    ),
    Question("grip_force_mN", "force of a usual grip", "mN", 20.0, "below the highest force"),
)
NUMBERED = (*RIG, *SENSOR, *ARM, *PART)
