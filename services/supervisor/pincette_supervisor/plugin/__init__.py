"""Public API of the supervisor for kinds of job.

A kind of job imports this module, its modules ``plans``, ``pair_plans``, ``laws``, ``goal``,
``figures``, ``result``, ``error_sources`` and ``drawing``, and ``pincette``, but nothing else of
the supervisor. Names in ``__all__`` of this module, and those of the others without an underscore,
change only with a new major version of pincette.
"""

from pincette_supervisor.plugin.errors import (
    FaultyRequestError,
    InstrumentBandwidth,
    UnsupportedError,
)
from pincette_supervisor.plugin.functions import (
    Evaluation,
    Interruption,
    JobFunctions,
    NextJob,
    Run,
)
from pincette_supervisor.plugin.model_in_use import (
    ASSUMED,
    RESIDUALS,
    UNITS,
    ModelInUse,
    learning_digest,
    value_of,
)
from pincette_supervisor.plugin.planned import Planned, Wait
from pincette_supervisor.plugin.present import Present

__all__ = [
    "ASSUMED",
    "RESIDUALS",
    "UNITS",
    "Evaluation",
    "FaultyRequestError",
    "InstrumentBandwidth",
    "Interruption",
    "JobFunctions",
    "ModelInUse",
    "NextJob",
    "Planned",
    "Present",
    "Run",
    "UnsupportedError",
    "Wait",
    "learning_digest",
    "value_of",
]
