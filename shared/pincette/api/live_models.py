"""What the samples of a rig look like while they come."""

from pydantic import BaseModel

from pincette.api.job_models import example

Column = list[float | None]


class LiveBatch(BaseModel):
    """Samples joined by their number, in columns of one length, all of one epoch and one phase.

    A column holds null where nothing is known: references while no program plays, the force before
    it was zeroed, the position where the sensor refused to read it.
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
        x_um=[39.91, 39.9],
        x_r_um=[39.9, 39.9],
        force_mN=[19.98, 20.02],
        force_r_mN=[20.0, 20.0],
        force_uncertainty_mN=[0.41, 0.41],
        voltage_V=[2.49, 2.49],
        sliding_um=[0.02, -0.01],
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
    x_um: Column
    x_r_um: Column
    force_mN: Column
    force_r_mN: Column
    force_uncertainty_mN: Column
    voltage_V: Column
    sliding_um: Column
