"""A calibration that deviates strongly from the calibrated value in use proposes nothing."""

import pytest

from pincette.config import Calibration, read_rig
from pincette_supervisor.kinds.calibrate.calibration import require_like_in_use
from pincette_supervisor.plugin import ModelInUse
from pincette_supervisor.plugin.model_in_use import rig_file_alone
from tests.support.rigs import DEMO

GAIN = "model.piezo_um_per_V"


def in_use(source: str | None) -> ModelInUse:
    """The demo rig, 19 µm/V, with that value from a calibration or assumed."""
    rig = read_rig(DEMO)
    sources = {} if source is None else {GAIN: source}
    calibration = Calibration(values={GAIN: rig.model.piezo_um_per_V}, sources=sources)
    return ModelInUse(rig, rig.digest(), version=1, calibration=calibration)


def test_a_gain_that_differs_much_from_the_calibrated_one_is_refused() -> None:
    with pytest.raises(ValueError, match=r"16\.6 µm/V, which is -13 % .* 19 µm/V .* c-7; .*part"):
        require_like_in_use(in_use("c-7"), GAIN, 16.6)


@pytest.mark.parametrize("gain_um_per_V", [17.2, 19.0, 20.8])
def test_a_slightly_changed_gain_of_an_aged_arm_is_accepted(gain_um_per_V: float) -> None:
    require_like_in_use(in_use("c-7"), GAIN, gain_um_per_V)


@pytest.mark.parametrize("gain_um_per_V", [1.9, 16.6, 190.0])
def test_similarity_is_not_judged_from_an_assumed_value(gain_um_per_V: float) -> None:
    require_like_in_use(in_use(None), GAIN, gain_um_per_V)
    require_like_in_use(rig_file_alone(read_rig(DEMO)), GAIN, gain_um_per_V)
