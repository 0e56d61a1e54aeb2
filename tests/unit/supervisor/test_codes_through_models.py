"""Every code of a fault, cause, outcome, ending and broken limit passes every model that has it."""

from typing import get_args

import msgspec
import pytest

from pincette.api.checks import FaultView
from pincette.api.endings import Ending, EndingCode
from pincette.api.events import Alarm
from pincette.api.jobs import Job
from pincette.api.predictions import Violation
from pincette.api.problems import TYPE
from pincette.api.results import OutcomeCode
from pincette.api.states import OUTCOMES
from pincette.client import InfeasiblePlanError, JobEndedError, ProblemError
from pincette.control.vocabulary import FaultCode, LimitedQuantity
from pincette.core.faults import Cause, Fault, Mode, Outcome, fault
from pincette.core.messages import Applied, Telemetry
from pincette.core.messages.arms import ArmApplied
from pincette.core.wording import cause_text
from pincette_supervisor.kinds.grip import GripResult
from tests.support.model_examples import example_of

NUMBERS = {"force_mN": 1.0, "limit_mN": 2.0, "seq": 3.0}


@pytest.mark.parametrize("code", list(FaultCode))
def test_every_fault_is_encoded(code: FaultCode) -> None:
    found = fault(code, "words", **NUMBERS)
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(found), type=Fault) == found
    assert example_of(FaultView, code=code, values=NUMBERS).code is code


@pytest.mark.parametrize("cause", list(Cause))
def test_every_cause_is_encoded(cause: Cause) -> None:
    applied = Applied(
        1,
        2,
        (ArmApplied(0.5, 0),),
        Mode.LATCHED,
        cause,
        False,
        False,
        False,
        answered=True,
        refused=0,
        command_age_s=0.02,
    )
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(applied), type=Applied).cause is cause
    assert example_of(Ending, trip=cause).trip == cause
    assert example_of(Alarm, cause=cause).cause == cause
    assert str(cause) in cause_text(cause)


@pytest.mark.parametrize("outcome", get_args(OutcomeCode))
def test_every_outcome_is_converted(outcome: OutcomeCode) -> None:
    assert example_of(GripResult, outcome=outcome).outcome == outcome
    job = example_of(Job, state="failed", result={"outcome": outcome})
    raised = JobEndedError("it has ended", job)
    assert raised.job.result == {"outcome": outcome}
    assert raised.codes["outcome"] == outcome
    if outcome in set(Outcome):
        assert OUTCOMES[outcome]


@pytest.mark.parametrize("code", get_args(EndingCode))
def test_every_ending_is_converted(code: EndingCode) -> None:
    ending = example_of(Ending, code=code).model_dump()
    job = example_of(Job, state="failed", ending=ending)
    assert job.ending.code == code
    raised = JobEndedError("it has ended", job)
    assert raised.job.ending is not None
    assert raised.job.ending.code == code
    assert raised.codes["ending"] == ending


@pytest.mark.parametrize("quantity", get_args(LimitedQuantity))
def test_every_exceeded_limit_is_converted(quantity: LimitedQuantity) -> None:
    broken = example_of(Violation, quantity=quantity)
    assert broken.quantity == quantity
    assert InfeasiblePlanError([broken]).codes["violations"][0]["quantity"] == quantity
    problem = {"type": f"{TYPE}limit-violation", "violations": [broken.model_dump()]}
    assert ProblemError(422, problem).codes["violations"][0]["quantity"] == quantity


def test_telemetry_has_the_outcome_type_of_the_controller() -> None:
    hints = msgspec.structs.fields(Telemetry)
    assert next(one.type for one in hints if one.name == "outcome") is Outcome
