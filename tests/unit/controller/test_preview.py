"""What a law that looks ahead is told: derivatives of the references that the player sets."""

import pytest
from msgspec.structs import replace

from pincette.control.laws.planned_motion import RESTING, PlannedMotion
from pincette.control.planning.path_shapes import sinusoid
from pincette.control.planning.program import Segment
from pincette_controller.player import begin
from pincette_controller.player_state import Player, at_tick
from pincette_controller.preview import planned_motion

from .bench import program

T = 1e-4
"""Short enough for differences to be derivatives."""
PATH = sinusoid("force", 12.0, 16.0, 10.0, 2)
CONTACT = {"contact_x_um": 26.0, "K_e_mN_per_um": 2.1}
SEGMENTS = {
    "free": Segment("approach", "free", 0.4, x_to_um=24.0),
    "seek": Segment("contact", "seek", 0.5, x_to_um=30.0, move_s=0.2),
    "force": Segment("load", "force", 0.4, force_to_mN=20.0),
    "settle": Segment("settle", "force", 0.9, force_to_mN=20.0, move_s=0.3),
    "quick": Segment("load", "force", 0.4, force_to_mN=20.0, follows=True),
    "pressed path": Segment("track", "path", PATH.duration_s, path=PATH),
    "free path": Segment(
        "track", "path", PATH.duration_s, path=sinusoid("position", 20.0, 8.0, 10.0, 2)
    ),
}
PER_KIND = pytest.mark.parametrize("name", SEGMENTS)


def player(name: str) -> Player:
    contact = CONTACT if SEGMENTS[name].presses else {}
    return replace(
        begin(program(), 20.0),
        segment=SEGMENTS[name],
        from_x_um=20.0,
        from_speed_um_per_s=15.0 if name == "free" else 0.0,
        from_force_mN=3.0,
        from_rate_mN_per_s=60.0 if name == "quick" else 0.0,
        **contact,
    )


@PER_KIND
def test_derivatives_are_those_of_the_references(name: str) -> None:
    moved = 0
    for tick in range(50, 3900, 77):
        places = [at_tick(player(name), tick + step, T).x_r_um for step in (-1, 0, 1)]
        told = planned_motion(at_tick(player(name), tick, T), T)
        speed = (places[2] - places[0]) / (2.0 * T)
        acceleration = (places[2] - 2.0 * places[1] + places[0]) / T**2
        assert told.speed_um_per_s == pytest.approx(speed, abs=0.02 + 1e-4 * abs(speed))
        assert told.acceleration_um_per_s2 == pytest.approx(acceleration, abs=3.0, rel=0.02)
        moved += abs(speed) > 1.0
    assert moved > 10


@PER_KIND
def test_the_contact_is_told_where_the_arm_presses(name: str) -> None:
    told = planned_motion(at_tick(player(name), 500, T), T)
    pressed = SEGMENTS[name].presses
    assert (told.K_e_mN_per_um, told.x_e_um) == ((2.1, 26.0) if pressed else (0.0, 0.0))


def test_what_rests_is_told_to_rest() -> None:
    rest = replace(player("settle"), paused=True, ticks=1000)
    assert planned_motion(rest, T) == PlannedMotion(0.0, 0.0, 2.1, 26.0)
    open_loop = Segment("jog", "voltage", 1.0, voltage_to_V=1.0)
    assert planned_motion(replace(player("free"), segment=open_loop, ticks=100), T) is RESTING
    unknown = replace(player("force"), contact_x_um=None, K_e_mN_per_um=None, ticks=1000)
    assert planned_motion(unknown, T) is RESTING
