"""Services of the loop that share a process: the rig file's setting, and its consequences."""

from pathlib import Path

import pytest

from pincette.config import ConfigError, parse_rig_json, read_rig
from pincette.core.service import CompositeService, canonical_name, member_services
from pincette.core.topics import LOOP
from pincette.engine.process import loop_services
from tests.support.partitions import composing, partitions

DEMO = Path(__file__).parents[3] / "deploy" / "rigs" / "demo.toml"
BASE = DEMO.read_text(encoding="utf-8")


def written(folder: Path, composed: str) -> Path:
    (folder / "base.toml").write_text(BASE, encoding="utf-8")
    path = folder / "rig.toml"
    path.write_text(f'base = "base.toml"\n[rig]\ncomposed = {composed}\n', encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("composed", "programs"),
    [
        ("[]", LOOP),
        ('["loop"]', ("loop",)),
        ('["actuator+controller+estimator+sensor"]', ("loop",)),
        ('["controller+estimator"]', ("sensor", "estimator+controller", "actuator")),
        (
            '["estimator+controller", "actuator+sensor"]',
            ("sensor+actuator", "estimator+controller"),
        ),
    ],
)
def test_programs_are_named_by_their_services_in_the_order_of_a_tick(
    tmp_path: Path, composed: str, programs: tuple[str, ...]
) -> None:
    rig = read_rig(written(tmp_path, composed))
    assert rig.programs == programs
    for name in programs:
        assert {rig.program_of(service) for service in member_services(name)} == {name}
    assert sorted(one for name in programs for one in member_services(name)) == sorted(LOOP)


@pytest.mark.parametrize(
    ("composed", "words"),
    [
        ('["sensor"]', r"rig\.composed\.0 = 'sensor': .*composes nothing: must be 'loop', or at"),
        ('["sensor+sensor"]', "composes nothing"),
        ('["sensor+recorder"]', "'recorder' is not a service of the loop: must be 'loop'"),
        ('["sensor + actuator"]', "'sensor ' is not a service of the loop"),
        ('["loop+actuator"]', "'loop' is not a service of the loop"),
        ('[""]', "'' is not a service of the loop"),
        (
            '["sensor+estimator", "estimator+actuator"]',
            "estimator is in 'sensor\\+estimator' and in 'estimator\\+actuator': it must be in one",
        ),
        ('["loop", "loop"]', "sensor is in 'loop' and in 'loop'"),
        ('"loop"', r"rig\.composed = 'loop'"),
    ],
)
def test_an_impossible_composition_is_named(tmp_path: Path, composed: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read_rig(written(tmp_path, composed))


def test_the_composition_is_not_part_of_the_digest() -> None:
    rig = read_rig(DEMO)
    assert composing(rig, "loop").digest() == rig.digest()
    loaded = parse_rig_json(composing(rig, "loop").model_dump_json())
    assert loaded.programs == ("loop",)


def test_a_loop_can_be_partitioned_in_fifteen_ways() -> None:
    found = partitions()
    assert len(set(found)) == len(found) == 15
    assert () in found
    assert ("loop",) in found


def test_programs_outside_the_loop_contain_no_services() -> None:
    assert [member_services(name) for name in ("router", "rig", "recorder", "supervisor")] == [
        ()
    ] * 4
    assert canonical_name("controller+sensor") == "sensor+controller"


def test_messages_inside_a_program_are_not_inputs() -> None:
    services = loop_services()
    pair = CompositeService("estimator+controller", (services["estimator"], services["controller"]))
    assert [item.topic.name for item in pair.inputs] == ["position", "applied"]
    whole = CompositeService("loop", tuple(services[name] for name in LOOP))
    assert whole.inputs == ()
    requested = {question.name for question in pair.requests}
    assert requested == {"arm", "status", "load", "action", "lease", "timing"}
