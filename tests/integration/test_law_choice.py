"""Every law that a job can choose, played by the whole loop, and the figures of its result."""

from functools import lru_cache
from statistics import pstdev
from typing import Any

import pytest
from pydantic import TypeAdapter

from pincette.api.requests import JobRequest
from pincette.api.results import ClosedLoopResult, Percentiles
from pincette.config import RigFile
from pincette.config.gains import tuned
from pincette.control.arm.plant import discretize, printed_arm
from pincette.control.laws.parameters import ParameterSet
from pincette.core.messages import Message, Sample
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.kinds.grip import GripResult
from pincette_supervisor.kinds.track import TrackResult
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.results.archive import Record, Take, gather
from tests.support.rigs import demo_rig

SCHEMES: tuple[str, ...] = ("pbsmic", "dsmifc")
SETS: tuple[ParameterSet, ...] = ("consistent", "printed")
RIG = demo_rig(time="lockstep")
PRINTED_K_S_MN = 0.003
REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)


def ended(body: dict[str, Any], rig: RigFile = RIG) -> Record:
    """Play a job to its end; returns it as it would be stored."""
    planned = plan_job(REQUEST.validate_python(body), rig)
    assert planned.plan.violations == []
    messages: list[Message] = [
        message
        for message in ComposedLoop(rig).play(planned.program)
        if not isinstance(message, Sample) or message.seq >= 0
    ]
    row = JobRow(
        id="job",
        kind=planned.plan.kind,
        rig=rig.rig.name,
        state="running",
        request=body,
        plan=planned.plan.model_dump(mode="json"),
        created_at="",
    )
    return gather(rig, row, planned, Take(1, messages))


@lru_cache
def played(kind: str, scheme: str, name: ParameterSet) -> Record:
    return ended({"kind": kind, "scheme": scheme, "set": name})


def percentiles(result: ClosedLoopResult, name: str) -> Percentiles:
    found = getattr(result, name)
    assert isinstance(found, Percentiles)
    assert 0.0 <= found.p50 <= found.p95 <= found.p99
    return found


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_grip_succeeds_with_every_law(scheme: str, name: ParameterSet) -> None:
    result = played("grip", scheme, name).result
    assert isinstance(result, GripResult)
    assert result.outcome == "gripped"
    assert result.force_held_mN == pytest.approx(20.0, abs=1.0)
    assert result.true_force_held_mN == pytest.approx(20.0, abs=2.0)
    assert result.rmse_position_um is not None
    assert result.rmse_position_um < 0.3


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_path_is_tracked_by_every_law(scheme: str, name: ParameterSet) -> None:
    result = played("track", scheme, name).result
    assert isinstance(result, TrackResult)
    assert result.outcome == "tracked"
    for tracking in (result.position_um, result.force_mN, result.true_force_mN):
        assert tracking is not None
        assert tracking.rmse_percent is not None
        assert tracking.rmse_percent < 10.0
    assert result.limits_acted == []


@pytest.mark.parametrize("kind", ["grip", "track"])
def test_the_laws_move_the_arm_differently(kind: str) -> None:
    tables = [played(kind, scheme, name).run.table for scheme in SCHEMES for name in SETS]
    voltages = [tuple(table["voltage_V"]) for table in tables]
    assert len(set(voltages)) == len(voltages)


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("kind", ["grip", "track"])
def test_a_result_states_the_error_of_the_model_used_by_the_law(
    kind: str, scheme: str, name: ParameterSet
) -> None:
    result = played(kind, scheme, name).result
    assert isinstance(result, ClosedLoopResult)
    plant = discretize(RIG.model.arm() if name == "consistent" else printed_arm(), 0.02)
    residual, error = (percentiles(result, n) for n in ("residual_um", "perturbation_error_mN"))
    # p̃ is -k̄ times the residual, for the parameter set that the law uses.
    assert error.p95 == pytest.approx(plant.k_bar * residual.p95)
    assert error.p99 == pytest.approx(plant.k_bar * residual.p99)
    # The residual of the true force is defined in the same way, in the same units.
    true_error = percentiles(result, "true_perturbation_error_mN")
    assert 0.3 * error.p95 < true_error.p95 < 3.0 * error.p95
    # The sensor's noise alone is far above the printed K_S.
    assert true_error.p50 > 10.0 * PRINTED_K_S_MN
    assert percentiles(result, "law_perturbation_mN").p99 > error.p99
    assert percentiles(result, "sliding_um").p99 > 0.0
    assert result.sliding_in_band is not None
    assert 0.0 < result.sliding_in_band < 1.0


def test_the_error_of_the_perturbation_at_rest_is_the_noise_of_the_sensor() -> None:
    """By (6) and (8): p̃ is k·(x_{k-1} - x_k), since a constant voltage and the mass contribute
    little."""
    held = ended({"kind": "grip", "profile": "gentle"})
    table = held.run.table
    x_um = [x for x, phase in zip(table["x_um"], table["phase"], strict=True) if phase == "hold"]
    true_um = [
        x for x, phase in zip(table["true_x_um"], table["phase"], strict=True) if phase == "hold"
    ]
    off_um = [measured - true for measured, true in zip(x_um, true_um, strict=True)]
    noise_um = pstdev(off_um)
    assert isinstance(held.result, ClosedLoopResult)
    true_error = percentiles(held.result, "true_perturbation_error_mN")
    # Half of a normal distribution lies within 0.674 standard deviations; two samples differ
    # by √2 of them.
    k = RIG.model.arm().k
    assert true_error.p50 == pytest.approx(0.674 * 2.0**0.5 * k * noise_um, rel=0.35)


@pytest.mark.parametrize("kind", ["grip", "track"])
def test_tuned_gains_of_both_laws_meet_their_specification(kind: str) -> None:
    for scheme in SCHEMES:
        found = tuned(RIG, scheme)
        kept = ended({"kind": kind, "scheme": scheme, "gains": "tuned"})
        law = kept.run.planned.values["law"]
        assert law["gains"] == found.chosen.settings.gains
        assert law["gains_from"] == "tuned"
        assert kept.result.outcome in ("gripped", "tracked")
        if isinstance(kept.result, TrackResult):
            position = kept.result.position_um
            assert position is not None
            assert position.rmse_percent is not None
            # All that the search knows of the rig comes from its identification.
            print(f"{scheme}: position {position.rmse_percent:.2f} %, {found.chosen}")
            assert position.rmse_percent < 3.0 * found.chosen.position_percent


def test_the_gains_of_a_job_take_effect() -> None:
    errors: list[float] = []
    for gain in (0.5, 5.0):
        gains = {"K_P": gain, "K_f": 0.0}
        result = ended({"kind": "track", "set": "consistent", "gains": gains}).result
        assert isinstance(result, TrackResult)
        assert result.position_um is not None
        errors.append(result.position_um.rmse)
    # Each sample takes the share K_I/(K_P + K_I) off the error: 2/3, and 1/6.
    assert errors[1] > 1.5 * errors[0]


def test_a_chosen_law_equals_the_same_law_in_the_rig_file() -> None:
    own = RIG.law.model_copy(update={"scheme": "dsmifc", "delta": 1e6, "K_P": 2.0})
    rig = RIG.model_copy(update={"law": own})
    chosen = ended({"kind": "grip", "scheme": "dsmifc", "gains": {"K_P": 2.0}})
    filed = ended({"kind": "grip"}, rig)
    assert chosen.run.table["voltage_V"] == filed.run.table["voltage_V"]
