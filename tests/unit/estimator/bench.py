"""An estimator that receives samples one by one, and rigs for it."""

from pathlib import Path
from typing import Any

from pincette.config import IdentifiedFreeResponse, RigFile, read_rig
from pincette.core.faults import Cause, Mode
from pincette.core.messages import Applied, Arm, Estimate, Position
from pincette.core.messages.arms import ArmApplied, ArmPosition
from pincette_estimator.config import EstimatorConfig
from pincette_estimator.step import Inputs, State, handle, start, step
from tests.support.arms import with_arm

DEMO = read_rig(Path(__file__).parents[3] / "deploy/rigs/demo.toml")
TAUGHT = IdentifiedFreeResponse(
    thresholds_V=(0.0, 0.5),
    weights_um_per_V=(10.0, 5.0),
    creep_times_s=(1.0,),
    creep_fractions=(0.1,),
    residual_um=0.1,
)
POSITION = Position(1, 0, 0.0, (ArmPosition(0.0, valid=True),))
APPLIED = Applied(
    1,
    -1,
    (ArmApplied(0.0, 0),),
    Mode.ARMED,
    Cause.NONE,
    False,
    False,
    False,
    answered=True,
    refused=0,
    command_age_s=0.02,
)


def a_rig(taught: IdentifiedFreeResponse | None, period_s: float = 0.02, **model: Any) -> RigFile:
    """Return the demo rig with this free response, and changes to its model."""
    changed = DEMO.model.model_copy(update={"free_response": taught, **model})
    rig = DEMO.rig.model_copy(update={"period_s": period_s})
    return DEMO.model_copy(update={"rig": rig, "model": changed})


class Bench:
    """Feeds an estimator sample by sample, always with the voltage of the sample before."""

    def __init__(self, config: EstimatorConfig) -> None:
        self.config = config
        self.state: State = start(config)
        self.arm(1)

    def arm(self, epoch: int, *, zero_confirmed: bool = False) -> None:
        request = Arm(epoch, 1, "", zero_confirmed=zero_confirmed)
        self.state, _, _ = handle(self.config, self.state, request, 0.0)
        self.epoch, self.seq = epoch, 0

    def feed(
        self,
        x_um: float,
        voltage_V: float | None,
        *,
        zero: bool = False,
        held: bool = False,
        answered: bool = True,
        state: Mode = Mode.ARMED,
        step_um: float | None = None,
    ) -> Estimate:
        applied = None
        if voltage_V is not None:
            applied = with_arm(
                APPLIED,
                epoch=self.epoch,
                seq=self.seq - 1,
                voltage_V=voltage_V,
                zero=zero,
                part_held=held,
                answered=answered,
                state=state,
                step_um=step_um,
            )
        position = with_arm(POSITION, epoch=self.epoch, seq=self.seq, x_um=x_um)
        self.state, outputs = step(self.config, self.state, Inputs(position, applied), 0.0)
        self.seq += 1
        (estimate,) = outputs
        assert isinstance(estimate, Estimate)
        return estimate

    def rest(self, x_um: float, voltage_V: float, count: int = 12) -> None:
        for _ in range(count):
            self.feed(x_um, voltage_V)
