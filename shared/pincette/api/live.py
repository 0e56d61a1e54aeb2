"""Samples of a rig, sent as they arrive, and the timing of its programs."""

from pydantic import Field

from pincette.api import Model, example
from pincette.api.rigs import STANDING, Standing

Column = list[float | None]


class SecondColumns(Model):
    """Columns of the second arm and of the part between both arms."""

    model_config = example(
        x_um=[29.4, 29.4],
        force_mN=[15.1, 15.0],
        voltage_V=[1.66, 1.66],
        place_um=[0.51, 0.52],
        place_r_um=[0.5, 0.5],
    )

    x_um: Column
    force_mN: Column
    voltage_V: Column
    place_um: Column
    place_r_um: Column


class LiveBatch(Model):
    """Samples of one epoch and one phase, joined by sample number, as columns of equal length.

    A column holds null where a value is unknown: references while no program plays, the force
    before it was zeroed, the position if the sensor could not measure it, and the voltage while the
    output has not confirmed it.
    """

    model_config = example(
        rig="demo",
        epoch=81985529216486895,
        playing=True,
        phase="hold",
        now_s=5121.32,
        dropped=0,
        seq=[445, 446],
        at_s=[5121.27, 5121.29],
        t_s=[8.9, 8.92],
        after_gap=[False, False],
        x_um=[39.91, 39.9],
        x_r_um=[39.9, 39.9],
        force_mN=[19.98, 20.02],
        force_r_mN=[20.0, 20.0],
        force_uncertainty_mN=[0.41, 0.41],
        voltage_V=[2.49, 2.49],
        sliding_um=[0.02, -0.01],
        standing=STANDING,
    )

    rig: str
    epoch: int
    """Random number of the arming. All samples between one arming and the next have the same
    number.
    """
    playing: bool
    """True while a program plays. Samples of an idle rig have only position and voltage."""
    phase: str
    """Name of the phase; empty while no program plays."""
    now_s: float
    """Time of sending by the supervisor's clock; its zero is arbitrary."""
    dropped: int
    """Number of samples lost since the last event, before this listener read them."""
    seq: list[int]
    at_s: list[float]
    """Arrival time of each position, by the same clock as ``now_s``. It does not restart with an
    epoch.
    """
    t_s: list[float]
    """Time since the arming, by the sensor's sampling grid."""
    after_gap: list[bool]
    """True for each sample that follows missing samples. A late sample is not missing."""
    x_um: Column
    x_r_um: Column
    force_mN: Column
    force_r_mN: Column
    force_uncertainty_mN: Column
    voltage_V: Column
    sliding_um: Column
    second: SecondColumns | None = None
    """Columns of the second arm; null on a rig with one arm."""
    standing: Standing | None = None
    """State of the actuator and the part at the time of sending."""


SPREAD = {"count": 1000, "p50_s": 9.4e-05, "p99_s": 3.1e-4, "p999_s": 5.5e-4, "max_s": 7.2e-4}
TIMED = {
    "program": "estimator",
    "epoch": 81985529216486895,
    "seq": 999,
    "missed": 0,
    "lateness": SPREAD,
    "age": SPREAD,
    "execution": SPREAD,
}


class LiveList(Model):
    """Samples for a client that polls instead of holding a stream."""

    model_config = example(batches=[], next=1834)

    batches: list[LiveBatch]
    next: int
    """Value of ``after`` for the next request."""


class Spread(Model):
    """Distribution of a duration. Quantiles are rounded up by at most 1/32."""

    model_config = example(**SPREAD)

    count: int
    p50_s: float | None
    """Median; null if nothing was counted."""
    p99_s: float | None
    p999_s: float | None
    max_s: float | None


class ProgramTiming(Model):
    """Timing of a program of the loop since the beginning of its epoch."""

    model_config = example(**TIMED)

    program: str
    epoch: int
    seq: int
    """Number of the newest sample that the statistics include."""
    missed: int
    """Number of samples and grid points that were skipped."""
    lateness: Spread
    """Lateness of wake-ups relative to the program's own grid; for a program without a grid,
    lateness of arriving samples relative to theirs."""
    age: Spread
    """Time from the arrival of the first message with a sample's number to the step that uses the
    sample.
    """
    execution: Spread
    """Duration of a step until all outputs are published, including exchanges with instruments."""


class LoopTiming(Model):
    """Timing of all programs of a loop; not measured in lockstep."""

    model_config = example(programs=[TIMED], silent={})

    programs: list[ProgramTiming]
    silent: dict[str, str] = Field(default_factory=dict[str, str])
    """Programs that did not reply, with the reason for each."""
