"""Samples of a rig as they come, and how punctual its programs have been."""

from pydantic import Field

from pincette.api import Model, example
from pincette.api.rigs import STANDING, Standing

Column = list[float | None]


class SecondColumns(Model):
    """Columns of the second arm, and of the part that both hold."""

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
    """Samples joined by their number, in columns of one length, all of one epoch and one phase.

    A column holds null where nothing is known: references while no program plays, the force before
    it was zeroed, the position where the sensor refused to read it, the voltage while the output
    has not confirmed it.
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
    """Of the arming; a random number that says only which samples belong together."""
    playing: bool
    """Whether a program plays; else the rig is idle, and has position and voltage alone."""
    phase: str
    """Empty while no program plays."""
    now_s: float
    """The supervisor's clock as this is sent; its zero means nothing."""
    dropped: int
    """Samples that were gone before this listener came to read them, since the last event."""
    seq: list[int]
    at_s: list[float]
    """When the position came, by the clock of ``now_s``: it goes on from one epoch to the next."""
    t_s: list[float]
    """Since the arming, by the sensor's grid."""
    after_gap: list[bool]
    """Whether samples are missing before this one; one that came late follows on."""
    x_um: Column
    x_r_um: Column
    force_mN: Column
    force_r_mN: Column
    force_uncertainty_mN: Column
    voltage_V: Column
    sliding_um: Column
    second: SecondColumns | None = None
    """Of a rig of two arms."""
    standing: Standing | None = None
    """How the actuator and the part stand as this is sent."""


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
    """Samples for a client that asks for them in turn and holds no stream."""

    model_config = example(batches=[], next=1834)

    batches: list[LiveBatch]
    next: int
    """Value of ``after`` for the next request."""


class Spread(Model):
    """How long something took; a quantile is up to 1/32 too long, and never too short."""

    model_config = example(**SPREAD)

    count: int
    p50_s: float | None
    """None where nothing was counted."""
    p99_s: float | None
    p999_s: float | None
    max_s: float | None


class ProgramTiming(Model):
    """How punctual a program of the loop has been since its epoch began."""

    model_config = example(**TIMED)

    program: str
    epoch: int
    seq: int
    """The newest sample that is counted."""
    missed: int
    """Samples and points of the grid that were skipped."""
    lateness: Spread
    """Of its wake-ups against its own grid, or else of its samples' arrival against theirs."""
    age: Spread
    """From the first arrival of a sample's number to the step with what it acts on."""
    execution: Spread
    """Of its steps, until all was told; instruments included."""


class LoopTiming(Model):
    """How punctual the programs of a loop have been; in lockstep nobody counts."""

    model_config = example(programs=[TIMED], silent={})

    programs: list[ProgramTiming]
    silent: dict[str, str] = Field(default_factory=dict[str, str])
    """Programs that have not said, each with why."""
