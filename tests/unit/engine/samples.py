"""Samples of one arm for the tests of the engine; ``replace`` makes others of them."""

from pincette.core.faults import Cause, Mode
from pincette.core.messages import Applied, Estimate, Position
from pincette.core.messages.arms import ArmApplied, ArmEstimate, ArmPosition

POSITION = Position(0, 0, 0.0, (ArmPosition(1.0, valid=True),))
IDLE = Applied(
    0,
    -1,
    (ArmApplied(0.0, 0),),
    Mode.IDLE,
    Cause.NONE,
    False,
    False,
    False,
    answered=False,
    refused=0,
    command_age_s=0.0,
)
ARMED = Applied(
    1,
    -1,
    (ArmApplied(0.5, 0),),
    Mode.ARMED,
    Cause.NONE,
    False,
    False,
    False,
    answered=True,
    refused=0,
    command_age_s=0.0,
)
ESTIMATE = Estimate(
    0,
    0,
    -1,
    False,
    False,
    (
        ArmEstimate(
            x_um=1.0,
            force_mN=0.0,
            force_uncertainty_mN=0.1,
            perturbation_mN=0.0,
            zero_age_s=None,
            zero_refusal=None,
            applied_V=0.0,
            limits_active=0,
        ),
    ),
    True,
)
