"""The rig program serves the output that the rig file's driver expects, with its line
terminators."""

from pathlib import Path

import pytest

from pincette.config import Output
from pincette.instruments.keyence_lkg import open_sensor
from pincette.instruments.srs_dc205 import open_output
from tests.support.rig_program import truths_of_three_writes
from tests.support.rigs import demo_rig

pytestmark = pytest.mark.usefixtures("stalls")


@pytest.mark.parametrize("pace", ["lockstep", "real"])
def test_each_write_over_the_line_reaches_the_simulated_rig_once(tmp_path: Path, pace: str) -> None:
    output = Output(driver="srs_dc205", url=str(tmp_path / "output"), timeout_s=0.5)
    rig = demo_rig(time=pace).model_copy(update={"output": output})
    reported = truths_of_three_writes(
        rig, tmp_path, lambda: open_sensor(rig.sensor), lambda: open_output(rig.output)
    )
    assert [truth.seq for truth in reported] == [0, 1, 2]
    assert [truth.arms[0].voltage_V for truth in reported] == pytest.approx(
        [1.0, 1.0, 0.5], abs=0.0007
    )
