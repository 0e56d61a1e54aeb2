"""Texts and tables of jobs and rigs for consoles and notebooks."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from pincette.api.jobs import Job
from pincette.client.following import force_asked_mN
from pincette.client.status import RigStatus

HEADINGS = ("rig", "state", "part", "force", "job")


def force_text(force_mN: Any, uncertainty_mN: Any) -> str:
    """Return a force with its expanded uncertainty as text; empty if it is unknown."""
    if force_mN is None:
        return ""
    spread = "" if uncertainty_mN is None else f" ± {uncertainty_mN:.2f}"
    return f"{force_mN:.2f}{spread} mN"


def job_facts(job: Job) -> dict[str, str]:
    """Return the known facts about a job that are shown, by name."""
    now, result = job.progress, job.result or {}
    held_mN, uncertainty_mN = result.get("force_held_mN"), result.get("force_uncertainty_mN")
    if held_mN is None and now is not None and not result:
        held_mN = now.force_mN if now.force_held_mN is None else now.force_held_mN
        uncertainty_mN = now.force_uncertainty_mN
    facts = {
        "state": job.state,
        "phase": "" if now is None or job.ended_at is not None else now.phase,
        "outcome": str(result.get("outcome") or ""),
        "force": force_text(held_mN, uncertainty_mN),
        "requested": force_text(force_asked_mN(job), None),
        "cause": job.cause,
    }
    return {name: text for name, text in facts.items() if text}


def job_line(job: Job) -> str:
    """Return a summary of a job in one line."""
    return f"{job.id}: {job.kind}, {', '.join(job_facts(job).values())}"


def job_html(job: Job, picture: bytes | None) -> str:
    """Return a job as an HTML table, with the plot of its record if it has one."""
    rows = "".join(
        f"<tr><th>{name}</th><td>{escape(text)}</td></tr>" for name, text in job_facts(job).items()
    )
    html = f"<table><caption>{escape(f'{job.kind} {job.id}')}</caption>{rows}</table>"
    if picture is None:
        return html
    data = b64encode(picture).decode("ascii")
    return f'{html}<img alt="{escape(job.kind)}" src="data:image/png;base64,{data}">'


def rigs_html(rigs: Mapping[str, RigStatus]) -> str:
    """Return the states of rigs as an HTML table, by name."""
    head = "".join(f"<th>{one}</th>" for one in HEADINGS)
    rows = "".join(_row(_rig_cells(name, status)) for name, status in rigs.items())
    return f"<table><tr>{head}</tr>{rows}</table>"


def _rig_cells(name: str, status: RigStatus) -> Sequence[str]:
    newest = status.newest
    force = "" if newest is None else force_text(newest.force_mN, newest.force_uncertainty_mN)
    return name, status.state, status.part, force, status.job or ""


def _row(cells: Sequence[str]) -> str:
    return f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
