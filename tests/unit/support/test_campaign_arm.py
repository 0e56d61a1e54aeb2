"""The arm of the campaign loses the energy of its ringing at a part."""

import pytest

from tests.support.campaign.arm import Part
from tests.support.campaign.drawing import draw

KICK_UM_PER_S = 4000.0


@pytest.mark.parametrize("stiffness_mN_per_um", [0.7, 2.17, 6.5])
def test_an_arm_that_bounces_off_a_part_comes_to_rest(stiffness_mN_per_um: float) -> None:
    arm = draw(1041).arm
    for step in range(40):
        arm.put_out(step / 40)
    arm.part = Part(arm.x_um - 0.2, stiffness_mN_per_um)
    arm.speed_um_per_s = KICK_UM_PER_S
    for _ in range(15):
        arm.put_out(1.0)
    assert abs(arm.speed_um_per_s) < 0.01 * KICK_UM_PER_S
