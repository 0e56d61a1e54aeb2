"""The search for gains, compiled: the tracks of ``control.stability.tuning`` by the thousand."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from functools import cache, partial
from math import sqrt
from typing import Any

import numpy as np

from pincette.control.arm.mode import sample_mode
from pincette.control.laws import law as control_law
from pincette.control.laws.definition import LawDefinition, LawSettings
from pincette.control.laws.law import FreeResponseInput
from pincette.control.response.identified_response import IdentifiedResponse
from pincette.control.response.play_operators import plays_of
from pincette.control.stability import tracks as kernels
from pincette.control.stability.tuning import (
    Sides,
    Tracked,
    Tracks,
    TuningPath,
    TuningRig,
    law_on,
    track_each,
)
from pincette_batch.compiling import as_record, available, compiled
from pincette_batch.executors import checked_workers, in_order
from pincette_batch.lanes import CHECKED, law_in

CHUNK = 250
"""Laws between two reports of progress."""


@cache
def _kernel(definition: LawDefinition) -> Any:
    return compiled(kernels.tracks, {**CHECKED, **law_in(definition)})


def compiled_tracks(
    rig: TuningRig, path: TuningPath, laws: Sequence[LawSettings], sides: Sides
) -> Iterator[Tracked]:
    """``track_each``, compiled; as it is where no compiler, law or response allows for that."""
    response = rig.response
    settled, samples = path.settled, len(path.force_r_mN) - path.settled
    short = samples < 1 or len(rig.noise_um) < len(path.force_r_mN)
    compilable = available() and all(law.definition.compiled for law in laws)
    if short or not compilable or not isinstance(response, IdentifiedResponse):
        yield from track_each(rig, path, laws, sides)
        return
    model = as_record(plays_of(response.model, rig.period_s))
    begun = np.array(response.memory.plays_V), np.array(response.memory.creep_um)
    memory = (*begun, np.empty_like(begun[0]), np.empty_like(begun[1]))
    noise_um, forces_r_mN = np.array(rig.noise_um), np.array(path.force_r_mN)
    wanted = np.array(sides)
    errors = np.empty((len(sides), 2))
    x_um = response.position_um()
    for settings in laws:
        law = law_on(rig, settings)
        arm = as_record(_pressed(rig, response, law.free))
        at_rest = control_law.start(
            law,
            x_um=x_um,
            x_r_um=x_um,
            force_mN=0.0,
            applied_V=response.voltage_V,
            memory=response.memory,
        )
        made = as_record((law.parameters, at_rest.law, law.force))
        _kernel(law.definition)(
            arm, *made, model, *memory, noise_um, forces_r_mN, settled, wanted, errors
        )
        yield [(sqrt(x / samples), sqrt(F / samples)) for x, F in errors.tolist()]


def _pressed(
    rig: TuningRig, response: IdentifiedResponse, free: FreeResponseInput | None
) -> kernels.PressedArm:
    """As ``tuning._Arm`` is made."""
    ratio = rig.stiffness_mN_per_um / rig.arm.k
    stiffer = sqrt(1.0 + ratio)
    omega = rig.natural_frequency_rad_per_s * stiffer
    zeta, delay_s = rig.damping_ratio / stiffer, rig.delay_s
    new = sample_mode(omega, zeta, rig.period_s - delay_s)
    return kernels.PressedArm(
        old=sample_mode(omega, zeta, delay_s) if delay_s > 0.0 else new,
        new=new,
        delayed=delay_s > 0.0,
        ratio=ratio,
        stiffness_mN_per_um=rig.stiffness_mN_per_um,
        arm_k_mN_per_um=rig.arm.k,
        offset_um=response.offset_um,
        voltage_V=response.voltage_V,
        static_um=response.memory.static_um,
        displacement_um=response.sample(0.0).displacement_um,
        inverts=free is not None,
        um_per_V=1.0 if free is None else free.um_per_V,
    )


def tracks_on(
    workers: int,
    progress: Callable[[int, int], None] | None = None,
    executor: Executor | None = None,
) -> Tracks:
    """``compiled_tracks`` on several processes, with reports of its progress.

    Parameters
    ----------
    progress
        Takes how many laws are done, and how many there are.
    executor
        Takes the laws instead of local processes.

    Raises
    ------
    ValueError
        Where ``workers`` is below 1.
    """
    checked_workers(workers)

    def play(
        rig: TuningRig, path: TuningPath, laws: Sequence[LawSettings], sides: Sides
    ) -> Iterator[Tracked]:
        chunks = [laws[at : at + CHUNK] for at in range(0, len(laws), CHUNK)]
        one = partial(_chunk, rig, path, sides)
        done = 0
        for found in in_order(one, chunks, workers, executor):
            yield from found
            done += len(found)
            if progress is not None:
                progress(done, len(laws))

    return play


def _chunk(
    rig: TuningRig, path: TuningPath, sides: Sides, laws: Sequence[LawSettings]
) -> list[Tracked]:
    return list(compiled_tracks(rig, path, laws, sides))
