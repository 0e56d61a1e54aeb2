"""Several services in one process, in real time: other programs see no difference."""

from collections.abc import Generator

import pytest

from pincette.core.messages import Applied, GroundTruth
from pincette.core.topics import LOOP
from tests.support.commands import pincette
from tests.support.grips import SHORT, hold, kill, make_ready, whole_grip
from tests.support.injections import MODULE_S, WATCHED
from tests.support.partitions import Programs
from tests.support.reactions import within
from tests.support.rigs import demo_rig, laid_over, output_step_V
from tests.support.running import RunningRig, running_rig
from tests.support.witness import HEARD, Witness

pytestmark = pytest.mark.usefixtures("stalls")

WHOLE: Programs = ("loop",)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    """The whole loop in one process, in real time; its output has a watchdog."""
    whole = laid_over(laid_over(SHORT, WATCHED), {"rig": {"composed": list(WHOLE)}})
    with running_rig(demo_rig(whole), tmp_path_factory.mktemp("rig")) as running:
        yield running


def test_a_grip_in_real_time_equals_that_of_five_programs(rig: RunningRig, seen: Witness) -> None:
    job = whole_grip(rig, seen)
    assert job["result"]["outcome"] == "gripped"
    view = rig.view()
    assert {one["name"] for one in view["programs"] if one["alive"]} == {*LOOP, "recorder"}
    assert view["can_start"], view["reasons"]
    for topic in HEARD:
        assert seen.newest(topic.message), f"{topic.name} is told"
        newest = seen.bus.latest(topic)
        assert type(newest) is topic.message, f"the newest {topic.name} allowed actions"
    output = pincette("doctor", "--rig", rig.path)
    assert "the actuator is part of loop" in output.stdout, output.stdout


def test_if_the_process_dies_the_module_becomes_safe_and_the_job_names_the_services(
    rig: RunningRig, seen: Witness
) -> None:
    job = hold(rig, seen)
    killed_s = kill(rig, "loop")
    step_V, safe_V = output_step_V(rig.rig), rig.rig.safety.safe_V
    safe_s, _ = seen.until(
        GroundTruth, lambda one: abs(one.arms[0].voltage_V - safe_V) <= step_V, killed_s
    )
    within(MODULE_S, safe_s - killed_s, "the module's watchdog")
    ended = rig.ended(job)
    assert ended["state"] == "failed"
    assert all(name in ended["cause"] for name in LOOP), ended["cause"]
    make_ready(rig)
    assert seen.newest(Applied).state == "idle"


def test_a_composed_program_that_is_stopped_brings_the_arm_to_rest(
    rig: RunningRig, seen: Witness
) -> None:
    hold(rig, seen)
    process = rig.fleet.members["loop"].process
    process.terminate()
    assert process.wait(10.0) == 0
    assert seen.newest(Applied).arms[0].voltage_V == rig.rig.safety.safe_V
    make_ready(rig)
