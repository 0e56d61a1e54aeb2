"""Measurements of this machine, kept in the data folder for ``up``, ``doctor`` and jobs."""

import json
import os
import platform
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from msgspec.structs import asdict

from pincette.config import RigFile
from pincette.core.files import make_folder, replace_file
from pincette.core.service import member_services
from pincette.engine.measuring.machine import Findings, distribution
from pincette.latency.advice import Asked, Change, changes
from pincette.latency.histogram import Distribution
from pincette.latency.rule import Measured

FILE = "machine.json"


class Kept(NamedTuple):
    """A measurement of this machine."""

    measured_at: str
    wake_ups: tuple[Measured, ...]
    hop: Distribution
    refused: str


def keep(data: Path, found: Findings, measured_at: str) -> None:
    """Store a measurement; one under load is stored in addition to that without load."""
    tree = {
        **_machine(),
        "measured_at": measured_at,
        "wake_ups": [
            {"period_s": one.period_s, "missed": one.missed, "lateness": asdict(one.lateness)}
            for one in found.wake_ups
        ],
        "hop": asdict(found.hop),
        "refused": found.refused,
    }
    with suppress(
        OSError
    ):  # the result has already been reported, and nothing depends on this copy
        make_folder(data, 0o700)
        replace_file(data / FILE, f"{json.dumps(tree, indent=1)}\n".encode(), 0o600)


def kept(data: Path) -> Kept | None:
    """Return the stored measurement of this machine; None if there is none."""
    try:
        tree: Any = json.loads((data / FILE).read_text(encoding="utf-8"))
        if {name: tree[name] for name in _machine()} != _machine():
            return None
        wake_ups = tuple(
            Measured(one["period_s"], distribution(one["lateness"]), one["missed"])
            for one in tree["wake_ups"]
        )
        if not wake_ups:
            return None
        return Kept(tree["measured_at"], wake_ups, distribution(tree["hop"]), tree["refused"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def how(rig: RigFile) -> str:
    """Return an instruction for measuring the machine."""
    return f"`pincette latency --seconds 5 --period-s {rig.rig.period_s:g}` measures the machine"


def asked(rig: RigFile) -> Asked:
    """Return the age limit, the priority and the programs stated in a rig file."""
    programs = [rig.realtime.of(*member_services(name)).priority for name in rig.programs]
    return Asked(
        rig.rig.period_s,
        rig.safety.command_age_periods,
        rig.realtime.computing_s,
        max(programs, default=0),
        rig.rig.composed,
    )


def changes_of(rig: RigFile, known: Kept | Findings) -> list[Change]:
    """Return the changes that a rig file needs on this machine.

    They are computed from the measurement whose period is nearest to that of the rig.
    """
    measured = _nearest(known, rig.rig.period_s)
    return changes(asked(rig), measured, known.hop, known.refused)


def _nearest(known: Kept | Findings, period_s: float) -> Measured:
    return min(known.wake_ups, key=lambda one: abs(one.period_s - period_s))


def words(rig: RigFile, known: Kept) -> str:
    """Return a text for people about the timing that this machine achieves."""
    measured = _nearest(known, rig.rig.period_s)
    late_ms = 1e3 * measured.lateness.max_s
    tail_ms = 1e3 * (measured.lateness.quantile_s(0.999) or 0.0)
    limit_ms = 1e3 * rig.safety.command_age_periods * rig.rig.period_s
    return (
        f"this machine wakes up late by {late_ms:.1f} ms at most, p99.9 {tail_ms:.1f} ms, at "
        f"{1e3 * measured.period_s:g} ms (measured {known.measured_at}); "
        f"age limit {limit_ms:.0f} ms"
    )


def _machine() -> dict[str, Any]:
    kernel = f"{platform.system()} {platform.release()} {platform.machine()}"
    return {"host": platform.node(), "kernel": kernel, "processors": os.cpu_count() or 1}
