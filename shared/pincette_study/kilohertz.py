"""At T = 1 ms: the law with a filtered perturbation on rigs that were calibrated at 20 ms."""

from pincette.config import RigFile
from pincette_study.rigs import simulation_of

FAST = ("substep_s", "sensor_step_um", "output_step_V", "output_lag_s", "actuation_delay_s")
"""What of a simulated rig belongs to its instruments."""


def at_kilohertz(rig: RigFile, fast: RigFile) -> RigFile:
    """The rig with instruments, period and law of ``fast``; arm, part and their models stay."""
    simulated, instruments = simulation_of(rig), simulation_of(fast)
    model = {"output_delay_s": fast.model.output_delay_s}
    model |= {"force_observer": fast.model.force_observer}
    return rig.model_copy(
        update={
            "rig": fast.rig,
            "sensor": fast.sensor,
            "output": fast.output,
            "realtime": fast.realtime,
            "law": fast.law,
            "grip": fast.grip,
            "model": rig.model.model_copy(update=model),
            "limits": rig.limits.model_copy(update={"slew_V_per_s": fast.limits.slew_V_per_s}),
            "simulation": simulated.model_copy(
                update={name: getattr(instruments, name) for name in FAST}
            ),
        }
    )
