"""What comes of a grip, as it is stored and sent."""

from pydantic import BaseModel

from pincette_supervisor.models import example
from pincette_supervisor.states import ActionType


class Phase(BaseModel):
    """A phase as it went."""

    model_config = example(phase="hold", start_s=8.9, duration_s=4.0)

    phase: str
    start_s: float
    duration_s: float


class Percentiles(BaseModel):
    """Percentiles of a magnitude, in the unit of its name."""

    model_config = example(p50=0.021, p95=0.064, p99=0.091)

    p50: float
    p95: float
    p99: float


class LimitActed(BaseModel):
    """A limit of the actuator that acted."""

    model_config = example(limit="slew_up", first_seq=344, samples=3)

    limit: str
    first_seq: int
    samples: int


class ActionTaken(BaseModel):
    """An action and the sample at which it took effect."""

    model_config = example(type="release", seq=611)

    type: ActionType
    seq: int


class GripResult(BaseModel):
    """Figures of a grip; a figure is null where the grip did not come that far."""

    model_config = example(
        outcome="gripped",
        phases=[{"phase": "hold", "start_s": 8.9, "duration_s": 4.0}],
        contact_x_um=31.1,
        contact_stiffness_mN_per_um=2.1,
        force_target_mN=20.0,
        force_held_mN=19.99,
        force_error_mN=-0.01,
        force_uncertainty_mN=0.42,
        zero_age_s=9.1,
        peak_force_mN=20.3,
        final_force_mN=0.1,
        rmse_position_um=0.031,
        rmse_force_mN=0.11,
        contact_rmse_position_um=0.042,
        contact_rmse_force_mN=0.14,
        residual_um={"p50": 0.021, "p95": 0.064, "p99": 0.091},
        perturbation_error_mN={"p50": 0.1, "p95": 0.3, "p99": 0.4},
        true_force_held_mN=19.8,
        limits_acted=[],
        actions=[],
        samples=820,
        missed_ticks=0,
        unanswered_ticks=0,
        dropped_messages=0,
    )

    outcome: str
    """gripped, released, stopped, no_contact, wrong_stiffness, lost, overforce, zero_refused,
    tripped, or unfinished."""
    phases: list[Phase]
    contact_x_um: float | None
    contact_stiffness_mN_per_um: float | None
    force_target_mN: float
    force_held_mN: float | None
    """Mean of the estimate over the hold, its first half second left out."""
    force_error_mN: float | None
    """Mean of the estimate less F_r over the same time."""
    force_uncertainty_mN: float | None
    zero_age_s: float | None
    """At the end of the hold."""
    peak_force_mN: float | None
    final_force_mN: float | None
    rmse_position_um: float | None
    """Over the hold."""
    rmse_force_mN: float | None
    """Over the hold."""
    contact_rmse_position_um: float | None
    """Over load, hold and unload."""
    contact_rmse_force_mN: float | None
    """Over load, hold and unload."""
    residual_um: Percentiles | None
    """Of the magnitude of x less its prediction, over all samples."""
    perturbation_error_mN: Percentiles | None
    true_force_held_mN: float | None
    """Known to a simulated rig alone; null on a real one."""
    limits_acted: list[LimitActed]
    actions: list[ActionTaken]
    samples: int
    missed_ticks: int
    """Samples that were never taken or never came here."""
    unanswered_ticks: int
    """Ticks for which the actuator took no command."""
    dropped_messages: int
