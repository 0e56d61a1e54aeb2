"""From a request to a plan: what is left out comes from the rig file."""

from dataclasses import replace

from pincette.api.job_kinds import JobKind, job_kinds
from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette_supervisor.kinds.functions import functions_of, kind_of
from pincette_supervisor.model.model_in_use import ModelInUse, rig_file_alone
from pincette_supervisor.model.residuals import armed_with, motion_digest, table_for
from pincette_supervisor.planning.errors import FaultyRequestError
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.planning.present import Present


def require_arms(kind: JobKind, rig: RigFile) -> None:
    """Refuse a kind that is not for as many arms as the rig has; raises FaultyRequestError."""
    arms = len(rig.arms)
    if arms in kind.arms:
        return
    offered = ", ".join(other.name for other in job_kinds().values() if arms in other.arms)
    wanted = " or ".join(map(str, kind.arms))
    raise FaultyRequestError(
        "/kind",
        f"{kind.name} is for {wanted} driven arm{'s' if wanted != '1' else ''}, and this rig has "
        f"{arms}: it takes {offered}",
    )


def plan_job(
    request: JobRequest, rig: RigFile | ModelInUse, present: Present | None = None
) -> Planned:
    """Plan a job; limits it breaks are in ``plan.violations``.

    Parameters
    ----------
    rig
        The rig with the model in use, or the rig file alone.
    present
        Where it stands; None: nobody has told.

    Raises
    ------
    FaultyRequestError
        Where members of the request do not go together.
    UnsupportedError
        Where the instruments are too slow for a calibration.
    ValueError
        Where the numbers make no plan.
    """
    model = rig if isinstance(rig, ModelInUse) else rig_file_alone(rig)
    require_arms(kind_of(request), model.rig)
    planned = functions_of(kind_of(request)).plan(request, model, present or Present())
    values = {**planned.values, "model": planned.model.stamp}
    values["program"] = motion_digest(planned.program)
    table = table_for(model.rig, planned.program)
    if table is not None:
        values["residual"] = table.model_dump(mode="json", exclude={"values_um", "stride_ticks"})
    armed = armed_with(model, table)
    return replace(
        planned, values=values, present=present, expecting=None if armed is model else armed
    )
