"""Which analysis a calibration wants."""

from collections.abc import Iterable

from pincette.messages import Message
from pincette.records.columns import Columns
from pincette_supervisor.analysis.arm import compliance, frequency_response, noise
from pincette_supervisor.analysis.contact import contact
from pincette_supervisor.analysis.findings import Analysis
from pincette_supervisor.analysis.free_response import free_response
from pincette_supervisor.analysis.samples import samples
from pincette_supervisor.planning.planned import Planned

ANALYSES = {
    "noise": noise,
    "free_response": free_response,
    "compliance": compliance,
    "contact_stiffness": contact,
}
"""Of the samples of the loop; that of the frequency response is of the sensor's buffer."""


def analyse(planned: Planned, table: Columns, messages: Iterable[Message]) -> Analysis:
    """Analyse a calibration that was played to its end.

    Raises
    ------
    ValueError
        Where the samples do not give what was asked for; the text says why.
    """
    name = planned.values["calibration"]
    if name == "frequency_response":
        return frequency_response(planned, messages)
    return ANALYSES[name](planned, samples(table, planned.model.rig.rig.period_s))
