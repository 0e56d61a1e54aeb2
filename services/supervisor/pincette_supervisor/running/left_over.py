"""What a supervisor does at its start about what an earlier one has left."""

from collections.abc import Sequence

from pincette.bus.protocol import BusError, RefusalError
from pincette.messages import Act, Status
from pincette.topics import ACT
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.running import recording
from pincette_supervisor.running.lease import LEASE_ENDED
from pincette_supervisor.running.part import newest_applied
from pincette_supervisor.running.site import Site

ARMED = "armed"
"""How the actuator's own words begin while a program plays."""
ASK_S = 1.0


def settle(site: Site, jobs: Sequence[str]) -> None:
    """Stop a program that still plays, and close the record of the job that was interrupted.

    It is asked once. A held part stays held until a person holds or releases it by a job; a free
    arm comes to rest. Nothing is taken up again.

    Parameters
    ----------
    jobs
        Those that the journal has just marked as interrupted, the newest last.
    """
    stopped = _stop(site) or _stopped_by_itself(site)
    row = site.store.get(jobs[-1]) if jobs else None
    if stopped:
        name = None if row is None else row.id
        with site.events.telling("rig", name, found="a program played", did=stopped):
            if row is not None:
                site.store.change(row.id, cause=f"{row.cause}; {stopped}")
    if row is not None and row.epoch is not None:
        # Making its tables takes its time, and an emergency stop must be taken meanwhile.
        site.archivist.submit(_close_record, site, row, row.epoch)


def _stop(site: Site) -> str:
    actuator = site.health.statuses.get("actuator")
    if not isinstance(actuator, Status) or not actuator.detail.startswith(ARMED):
        return ""
    try:
        site.bus.ask(ACT, Act("stop"), ASK_S)
    except RefusalError as error:
        return f"the program was not stopped: {error}"
    except BusError as error:
        return f"the program that still plays could not be stopped: {error}"
    return "the program that still played was stopped after the restart; a held part stays held"


def _stopped_by_itself(site: Site) -> str:
    """What the controller says of a lease that has ended while no supervisor was there."""
    controller = site.health.statuses.get("controller")
    words = controller.detail if isinstance(controller, Status) else ""
    if not words.startswith(LEASE_ENDED):
        return ""
    site.alarms.raised("lease", words, severity="alarm", clears="acknowledge")
    return words


def _close_record(site: Site, row: JobRow, epoch: int) -> None:
    """Have the recorder close what it still records, and keep what it says of it."""
    applied = newest_applied(site)
    last_seq = recording.NOTHING
    if applied is not None and applied.epoch == epoch:
        last_seq = applied.seq
    recorded = recording.finish(site.bus, row.id, epoch, last_seq)
    if isinstance(recorded, str):  # it may still make the tables of what nobody had finished
        recorded = recording.finish(site.bus, row.id, epoch, last_seq)
    site.store.change(row.id, plan={**row.plan, "record": recording.completeness(recorded)})
