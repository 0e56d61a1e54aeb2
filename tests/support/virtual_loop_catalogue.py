"""Faults of the loop, by the rows of the fault table: those that must trip, and their
counterparts."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from math import nan
from typing import NamedTuple

from pincette.config import RigFile
from pincette.core.topics import LOOP
from tests.support.virtual_loop_faults import LinkFault
from tests.support.virtual_loop_injection import Fault
from tests.support.virtual_loop_places import T

LINKS = (
    ("sensor", "estimator"),
    ("sensor", "actuator"),
    ("estimator", "controller"),
    ("controller", "actuator"),
    ("actuator", "estimator"),
)
"""Every link used in a tick."""
TO_THE_ACTUATOR = ("sensor", "actuator")
BEHIND_THE_SENSOR = ("estimator", "controller", "actuator")
BEFORE_THE_COMMAND = ("sensor", "estimator", "controller")
ROW_OF_DEAD = {"sensor": 1, "estimator": 6, "controller": 7}
ROW_OF_HUNG = {"sensor": 1, "estimator": 6, "controller": 8}
NUMBERS = {
    "sensor": "x_um",
    "estimator": "force_mN",
    "controller": "voltage_V",
    "actuator": "voltage_V",
}
"""The most important field in each program's messages."""
ABSURD_SEQ = 2**53
HUNG_S = (0.08, 0.2)
"""Duration of a hang, in s: longer than any limit; the shorter one ends while the actuator is
still frozen or ramping."""
HUNG_SHORT_S = (0.02, 0.2)
"""The same at T = 1 ms."""


def _link(befalls: str, source: str, to: str, late_s: float = 0.0) -> LinkFault:
    match befalls:
        case "lost":
            return LinkFault("lost", source, to)
        case "twice":
            return LinkFault("twice", source, to, late_s=late_s)
        case "unreadable":
            return LinkFault("unreadable", source, to)
        case _:
            return LinkFault("late", source, to, late_s=late_s)


def _isolated(name: str) -> Fault:
    both = (LinkFault("lost", name, "*"), LinkFault("lost", "*", name))
    return Fault(f"{name} cut off", 12, "trip", "link", links=both)


class Catalogue(NamedTuple):
    """The faults of a loop at some period."""

    fatal: tuple[Fault, ...]
    """Faults after which no good command arrives any more, or none for longer than the age
    limit."""
    harmless: tuple[Fault, ...]
    """Faults just below the limits: no false trip, and the loop continues."""
    lost_once: tuple[Fault, ...]
    """Return the fault that the actuator does not receive one sample."""


def catalogue(T: float, hung_s: tuple[float, ...] = HUNG_S) -> Catalogue:
    """Return the faults at a period in s."""
    briefly_s = 0.9 * T  # a program publishes at most once in it
    late_s, a_little_late_s, step_s = 3.0 * T, 0.4 * T, 4.0 * T

    def echo_s(source: str) -> float:
        # A lost echo is first noticed with the next sample, up to a period after the cut; on the
        # other links the actuator itself notices the next missing message.
        return T if source == "actuator" else 0.0

    def corrupt(source: str, field: str, value: float, row: int, for_s: float | None) -> Fault:
        must = "trip" if for_s is None else "carry on"
        link = LinkFault("corrupt", source, field=field, value=value)
        times = "" if for_s is None else ", once"
        name, late_s = f"{source}: {field} = {value:g}{times}", echo_s(source)
        return Fault(name, row, must, "link", for_s=for_s, links=(link,), late_s=late_s)

    fatal: tuple[Fault, ...] = (
        *(
            Fault(f"{who} killed", ROW_OF_DEAD[who], "trip", "kill", who)
            for who in BEFORE_THE_COMMAND
        ),
        *(
            Fault(
                f"{who} hung for {1e3 * for_s:g} ms", ROW_OF_HUNG[who], "trip", "stop", who, for_s
            )
            for who in BEFORE_THE_COMMAND
            for for_s in hung_s
        ),
        *(
            Fault(
                f"{source} -> {to} cut",
                12,
                "trip",
                "link",
                links=(_link("lost", source, to),),
                late_s=echo_s(source),
            )
            for source, to in LINKS
        ),
        *(_isolated(name) for name in (*BEFORE_THE_COMMAND, "actuator")),
        *(
            Fault(
                f"{source} -> {to} {1e3 * late_s:g} ms late",
                5,
                "trip",
                "link",
                links=(_link("late", source, to, late_s),),
                late_s=echo_s(source),
            )
            for source, to in LINKS
        ),
        *(corrupt(source, field, nan, 4, None) for source, field in NUMBERS.items()),
        *(
            Fault(
                f"{source} unreadable",
                15,
                "trip",
                "link",
                links=(_link("unreadable", source, "*"),),
                late_s=echo_s(source),
            )
            for source in NUMBERS
        ),
        *(
            Fault(f"a step of the {who} takes {1e3 * step_s:g} ms", 17, "trip", "slow", who, step_s)
            for who in BEFORE_THE_COMMAND
        ),
        Fault("sensor over range", 3, "trip", "bench", target="sensor", what="over_range"),
        Fault("sensor says garbage", 15, "trip", "bench", target="sensor", what="garbage"),
        Fault("sensor unplugged", 1, "trip", "bench", target="sensor", what="off"),
    )
    harmless: tuple[Fault, ...] = (
        *(
            Fault(f"{who} hung for {1e3 * briefly_s:g} ms", row, "carry on", "stop", who, briefly_s)
            for who, row in (*ROW_OF_HUNG.items(), ("actuator", 17))
        ),
        *(
            Fault(
                f"{source} -> {to}: one lost",
                12,
                "carry on",
                "link",
                for_s=briefly_s,
                links=(_link("lost", source, to),),
            )
            for source, to in LINKS
            if (source, to) != TO_THE_ACTUATOR
        ),
        *(
            Fault(
                f"{source} -> {to} {1e3 * a_little_late_s:g} ms late",
                5,
                "carry on",
                "link",
                links=(_link("late", source, to, a_little_late_s),),
            )
            for source, to in LINKS
        ),
        Fault(
            "all is said twice",
            13,
            "carry on",
            "link",
            links=(_link("twice", "*", "*", a_little_late_s),),
        ),
        *(
            Fault(
                f"{source} -> {to}: one overtaken by the next",
                13,
                "carry on",
                "link",
                for_s=briefly_s,
                links=(_link("late", source, to, 1.2 * T),),
            )
            for source, to in LINKS
            if (source, to) != TO_THE_ACTUATOR
        ),
        *(corrupt(source, NUMBERS[source], nan, 4, briefly_s) for source in BEHIND_THE_SENSOR),
        *(corrupt(source, NUMBERS[source], 1e300, 4, briefly_s) for source in BEHIND_THE_SENSOR),
        *(corrupt(source, "seq", ABSURD_SEQ, 4, briefly_s) for source in BEHIND_THE_SENSOR),
        *(
            Fault(
                f"a step of the {who} takes {1e3 * 0.6 * T:g} ms",
                17,
                "carry on",
                "slow",
                who,
                0.6 * T,
            )
            for who in (*BEFORE_THE_COMMAND, "actuator")
        ),
        Fault(
            "sensor over range, once",
            3,
            "carry on",
            "bench",
            "",
            briefly_s,
            (),
            "sensor",
            "over_range",
        ),
        Fault("a second controller", 9, "carry on", "rival"),
    )
    lost_once: tuple[Fault, ...] = (
        Fault(
            "sensor -> actuator: one lost",
            5,
            "carry on",
            "link",
            for_s=briefly_s,
            links=(_link("lost", *TO_THE_ACTUATOR),),
        ),
        Fault(
            "one sample lost for all",
            5,
            "carry on",
            "link",
            for_s=briefly_s,
            links=(_link("lost", "sensor", "*"),),
        ),
        Fault(
            "sensor -> actuator: one overtaken by the next",
            13,
            "carry on",
            "link",
            for_s=briefly_s,
            links=(_link("late", *TO_THE_ACTUATOR, 1.2 * T),),
        ),
        corrupt("sensor", "x_um", nan, 4, briefly_s),
        corrupt("sensor", "x_um", 1e300, 4, briefly_s),
        corrupt("sensor", "seq", ABSURD_SEQ, 4, briefly_s),
    )
    return Catalogue(fatal, harmless, lost_once)


FATAL, HARMLESS, LOST_ONCE = catalogue(T)
ECHO_LATE_S = T


def befalling(rig: RigFile, faults: Iterable[Fault]) -> Iterator[Fault]:
    """Return each fault of a service as a fault of its program; without impossible ones.

    There is no link between two services of one program. If the actuator's program is killed or
    hangs, no program is left to trip; this is judged separately.
    """
    having = rig.program_of("actuator")
    for fault in faults:
        who = rig.program_of(fault.who) if fault.who else ""
        if fault.deed == "rival" and rig.program_of("controller") != "controller":
            continue
        if fault.must == "trip" and who == having:
            continue
        links = tuple(_links(rig, fault))
        if links or fault.deed != "link":
            echoes = fault.must == "trip" and any(link.source == having for link in links)
            late_s = max(fault.late_s, rig.rig.period_s) if echoes else fault.late_s
            yield replace(fault, who=who, links=links, late_s=late_s)


def _links(rig: RigFile, fault: Fault) -> Iterator[LinkFault]:
    if len(rig.programs) == 1:
        return
    for link in fault.links:
        source, to = (rig.program_of(one) if one in LOOP else one for one in (link.source, link.to))
        if source == "*" or source != to:
            yield replace(link, source=source, to=to)
