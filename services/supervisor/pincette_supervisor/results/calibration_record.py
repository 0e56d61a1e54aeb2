"""From the samples of a calibration to its result and its folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pincette.api.calibration_models import CalibrationResult
from pincette.api.states import GOOD_OUTCOMES
from pincette.config import RigFile
from pincette.messages import Recorded
from pincette.records.columns import Columns, columns
from pincette_supervisor.analysis.analyse import analyse
from pincette_supervisor.analysis.findings import Analysis
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.model.quantities import ASSUMED
from pincette_supervisor.planning.calibration_plans import rests_on
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.results.archive import Take, about
from pincette_supervisor.results.calibration_plots import picture
from pincette_supervisor.results.documents import NOT_RECORDED, write_documents
from pincette_supervisor.results.result import course, outcome_of


@dataclass(frozen=True, slots=True)
class CalibrationRecord:
    """A calibration's samples in columns, and what came of them."""

    job: JobRow
    planned: Planned
    table: Columns
    result: CalibrationResult
    analysis: Analysis | None
    epoch: int
    fault: str
    """Why a motion that was played to its end gives no values; empty where it does."""

    @property
    def tree(self) -> dict[str, Any]:
        """The result as it is stored and sent."""
        return self.result.model_dump(mode="json")

    def write(self, folder: Path, recorded: Recorded | str = NOT_RECORDED) -> None:
        """Write everything but the samples, which are the recorder's; raises OSError."""
        name = f"{self.planned.model.rig.rig.name} · {self.job.id}"
        write_documents(
            folder,
            self.job,
            self.planned,
            result=self.tree,
            picture=picture(self.table, self.result, self.analysis, name=name),
            whose=about(self.planned, self.job, self.epoch),
            recorded=recorded,
        )


def gather(rig: RigFile, job: JobRow, planned: Planned, take: Take) -> CalibrationRecord:
    """Join the samples, and where the motion was played to its end, analyse them."""
    table = columns(take.messages, rig.rig.period_s)
    outcome, analysis, fault = outcome_of(table), None, ""
    if outcome in GOOD_OUTCOMES:
        try:
            analysis = analyse(planned, table, take.messages)
        except ValueError as error:
            fault = f"no values: {error}"
    name = planned.values["calibration"]
    resting = rests_on(name, planned.model)
    result = CalibrationResult(
        **course(table, period_s=rig.rig.period_s, dropped=take.dropped),
        calibration=name,
        values=[] if analysis is None else list(analysis.values),
        figures=[] if analysis is None else list(analysis.figures),
        residuals=None if analysis is None else analysis.residuals,
        statement=fault if analysis is None else analysis.statement,
        warnings=[
            *(() if analysis is None else analysis.warnings),
            *(
                f"rests on {item.quantity}, which is assumed: calibrate it first"
                for item in resting
                if item.source == ASSUMED
            ),
        ],
        rests_on=resting,
    )
    return CalibrationRecord(job, planned, table, result, analysis, take.epoch, fault)
