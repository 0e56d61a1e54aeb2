"""``tuning.track`` over arrays, for thousands of gains: several plans played with one law.

Arrays and flat records alone, so that it can be compiled as it stands; the bits are those of
``track``. ``law_step`` stands for the step of a law, which the linker puts there.
"""

from typing import Any, NamedTuple

from pincette.control.arm.mode import Mode
from pincette.control.laws.force_input import ForceInput, input_force
from pincette.control.laws.sliding import LawOutput
from pincette.control.response.play_operators import Floats, Plays, crept, voltage_for, yielded


def law_step(
    parameters: Any,
    state: Any,
    *,
    x_um: float,
    force_mN: float,
    applied_V: float,
    x_r_um: float,
    force_r_mN: float,
    limited: int,
) -> tuple[Any, LawOutput]:
    """As ``LawDefinition.step``, in whose place this stands until a kernel is linked."""
    raise NotImplementedError


class PressedArm(NamedTuple):
    """``tuning.TuningRig`` as the tracks need it."""

    old: Mode
    """Until the voltage arrives; of no matter where it does not lag."""
    new: Mode
    delayed: bool
    ratio: float
    """K_e/k."""
    stiffness_mN_per_um: float
    arm_k_mN_per_um: float
    offset_um: float
    """Of the free response."""
    voltage_V: float
    static_um: float
    displacement_um: float
    """Of its model, at the first touch."""
    inverts: bool
    """Whether the law works with the free response, else with the line."""
    um_per_V: float
    """Mean slope of the free response; see ``law.FreeResponseInput``."""


def tracks(
    k: PressedArm,
    parameters: Any,
    begun: Any,
    force: ForceInput,
    model: Plays,
    begun_V: Floats,
    begun_um: Floats,
    plays_V: Floats,
    creep_um: Floats,
    noise_um: Floats,
    forces_r_mN: Floats,
    settled: int,
    sides: Floats,
    errors: Floats,
) -> None:
    """Play the path once for each row of ``sides``.

    Parameters
    ----------
    begun_V, begun_um
        Memory of the free response at the first touch: its plays and its creep.
    plays_V, creep_um
        As long as these; they are overwritten.
    sides
        Shape (n, 3): the plan's stiffness in mN/µm, by how much the force is read too high in mN,
        how much steeper the free response is than its model.
    errors
        Shape (n, 2): x - x_r in µm and F - F_r in mN, squared and summed; filled.
    """
    for side in range(len(sides)):
        plays_V[:] = begun_V
        creep_um[:] = begun_um
        one_track(
            k,
            parameters,
            begun,
            force,
            model,
            plays_V,
            creep_um,
            noise_um,
            forces_r_mN,
            settled,
            sides[side],
            errors[side],
        )


def one_track(
    k: PressedArm,
    parameters: Any,
    state: Any,
    force: ForceInput,
    model: Plays,
    plays_V: Floats,
    creep_um: Floats,
    noise_um: Floats,
    forces_r_mN: Floats,
    settled: int,
    side: Floats,
    errors: Floats,
) -> None:
    """One plan; ``side`` and ``errors`` are rows of those of ``tracks``."""
    planned_mN_per_um, force_error_mN, steeper = side[0], side[1], side[2]
    displacement_um = k.displacement_um
    free_um = k.offset_um + displacement_um
    x_e_um = x_um = free_um
    v, static_um = 0.0, k.static_um
    before_r_mN = before_error_mN = 0.0
    applied_V = k.voltage_V
    position_square = force_square = 0.0
    for index in range(len(forces_r_mN)):
        force_r_mN, noise = forces_r_mN[index], noise_um[index]
        x_r_um = x_e_um + force_r_mN / planned_mN_per_um
        true_mN = k.stiffness_mN_per_um * (x_um - x_e_um)
        read_mN = true_mN + force_error_mN - noise * k.arm_k_mN_per_um
        force_mN, before_error_mN = input_force(
            force, read_mN, force_r_mN, before_r_mN, before_error_mN
        )
        before_r_mN = force_r_mN
        seen_V = displacement_um / k.um_per_V if k.inverts else applied_V
        state, output = law_step(
            parameters,
            state,
            x_um=x_um + noise,
            force_mN=force_mN,
            applied_V=seen_V,
            x_r_um=x_r_um,
            force_r_mN=force_r_mN,
            limited=0,
        )
        voltage_V = output.voltage_V
        if k.inverts:
            wanted_um = k.um_per_V * voltage_V
            voltage_V = voltage_for(
                model, plays_V, creep_um, static_um, applied_V, wanted_um, k.um_per_V
            )
        if k.delayed:
            x_um, v = passed(k.old, free_um, x_e_um, k.ratio, x_um, v)
        if voltage_V != applied_V:
            static_um = yielded(model, plays_V, applied_V, voltage_V)
        applied_V = voltage_V
        displacement_um = crept(model, creep_um, static_um)
        free_um = k.offset_um + displacement_um
        if steeper != 1.0:
            free_um = x_e_um + steeper * (free_um - x_e_um)
        x_um, v = passed(k.new, free_um, x_e_um, k.ratio, x_um, v)
        if index >= settled:
            off_um = x_um - x_r_um
            off_mN = k.stiffness_mN_per_um * (x_um - x_e_um) - force_r_mN
            position_square += off_um * off_um
            force_square += off_mN * off_mN
    errors[0], errors[1] = position_square, force_square


def passed(
    mode: Mode, free_um: float, touch_um: float, ratio: float, x_um: float, v: float
) -> tuple[float, float]:
    """The arm pressed on its contact, after the time of a mode."""
    rest_um = (free_um + ratio * touch_um) / (1.0 + ratio)
    off_um = x_um - rest_um
    return rest_um + mode.xx * off_um + mode.xv * v, mode.vx * off_um + mode.vv * v
