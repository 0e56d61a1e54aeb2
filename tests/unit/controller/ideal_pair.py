"""Two ideal arms on the line d_p·u with a part between them, and the controller that moves them."""

from collections.abc import Callable, Mapping

from pincette.config import RigFile
from pincette.control.planning.pair_plan import PairRequest
from pincette.control.planning.program import Program
from pincette.core.faults import ActionCode
from pincette.core.messages import Action, Arm, Command, Estimate, Load, Telemetry
from pincette.core.messages.arms import ArmEstimate
from pincette_controller import SERVICE
from tests.support.two_arms import two_arm_rig

PERIOD_S = 0.02
GAP_UM = 12.3
"""x_1 + x_2 at contact of both, where the part lies 0.05 µm off the middle."""
NEAR_UM = 6.2
LONGEST = 3000


def linear_rig() -> RigFile:
    """Return the rig of two arms with the line of d_p as free response."""
    rig = two_arm_rig()
    assert rig.second is not None
    first, second = (
        each.model_copy(update={"free_response": None}) for each in (rig.model, rig.second.model)
    )
    return rig.model_copy(
        update={"model": first, "second": rig.second.model_copy(update={"model": second})}
    )


RIG = linear_rig()


def request(**changes: float | bool) -> PairRequest:
    """Return the request for the contact with the part."""
    assert RIG.second is not None
    return PairRequest(
        **{
            "force_mN": 8.0,
            "load_s": 0.5,
            "approach_um_per_s": 20.0,
            "seek_um_per_s": 8.0,
            "contact_force_mN": 0.8,
            "zero_s": 0.2,
            "contacts_um": (RIG.part.contact_um, RIG.second.contact_um),
            "contact_tolerance_um": 1.5,
            "stiffness_mN_per_um": 40.0,
            **changes,
        }  # pyright: ignore[reportArgumentType]
    )


class IdealPair:
    """Estimates are exact; a part in contact with only one arm yields with stiffness K_GROUND."""

    K_GROUND = 5.0

    def __init__(self, program: Program) -> None:
        self.config = SERVICE.configure(RIG)
        state = SERVICE.start(self.config)
        state, *_ = SERVICE.handle(self.config, state, Load(program), 0.0)
        self.state, *_ = SERVICE.handle(self.config, state, Arm(epoch=1, owner=1, digest=""), 0.0)
        self.voltages_V = (0.0, 0.0)
        self.zeroed_at: int | None = None
        self.part = True
        self.change: Callable[[Estimate], Estimate] = lambda estimate: estimate
        self.seq = 0

    def forces(self) -> tuple[float, float]:
        """Return F_1 and F_2 of the applied voltages."""
        if not self.part:
            return 0.0, 0.0
        s_1, s_2 = (arm.model.compliance_um_per_mN for arm in RIG.arms)
        c = 1.0 / RIG.part.stiffness_mN_per_um
        both = (sum(self._free()) - GAP_UM) / (s_1 + s_2 + c)
        if both > 0.0:
            return both, both
        ground = 1.0 / self.K_GROUND
        one = max(0.0, (self._free()[0] - NEAR_UM) / (s_1 + ground))
        two = max(0.0, (self._free()[1] - (GAP_UM - NEAR_UM)) / (s_2 + ground))
        return one, two

    def _free(self) -> tuple[float, float]:
        first, second = (
            arm.model.piezo_um_per_V * u for arm, u in zip(RIG.arms, self.voltages_V, strict=True)
        )
        return first, second

    def tick(self, action: ActionCode | None = None) -> tuple[Command, Telemetry]:
        """Play one tick; an action is recorded before it."""
        if action is not None:
            self.state, *_ = SERVICE.handle(self.config, self.state, Action(action), 0.0)
        (F_1, F_2), (X_1, X_2) = self.forces(), self._free()
        s_1, s_2 = (arm.model.compliance_um_per_mN for arm in RIG.arms)
        age_s = None if self.zeroed_at is None else (self.seq - self.zeroed_at) * PERIOD_S
        estimate = Estimate(
            epoch=1,
            seq=self.seq,
            applied_seq=self.seq - 1,
            tripped=False,
            degraded=False,
            arms=(
                ArmEstimate(
                    x_um=X_1 - s_1 * F_1,
                    force_mN=F_1,
                    force_uncertainty_mN=0.1,
                    perturbation_mN=0.0,
                    zero_age_s=age_s,
                    zero_refusal=None,
                    applied_V=self.voltages_V[0],
                    limits_active=0,
                ),
                ArmEstimate(X_2 - s_2 * F_2, F_2, 0.1, 0.0, age_s, None, self.voltages_V[1], 0),
            ),
            valid=True,
        )
        inputs = SERVICE.inputs_type(self.change(estimate))
        self.state, outputs = SERVICE.step(self.config, self.state, inputs, 0.0)
        command, telemetry = outputs
        assert isinstance(command, Command)
        assert isinstance(telemetry, Telemetry)
        assert len(command.arms) == 2
        self.voltages_V = command.arms[0].voltage_V, command.arms[1].voltage_V
        self.seq += 1
        if command.zero:
            self.zeroed_at = self.seq
        return command, telemetry

    def play(self, actions: Mapping[str, ActionCode] | None = None) -> list[Telemetry]:
        """Play to the end; an action takes place half a second into its phase."""
        found: list[Telemetry] = []
        left = dict(actions or {})
        while len(found) < LONGEST:
            last = found[-1] if found else None
            into = [t for t in found if last is not None and t.phase == last.phase]
            due = last is not None and last.phase in left and len(into) >= 25
            command, reported = self.tick(
                left.pop(last.phase) if due and last is not None else None
            )
            found.append(reported)
            if command.final:
                return found
        raise AssertionError("the program does not end")
