"""System settings that programs request, their messages if these are refused, and one real
attempt."""

import json
import logging
import os
import resource
import subprocess
import sys
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from pincette.config import ConfigError, parse_rig, parse_rig_json
from pincette.config.programs import Scheduling
from pincette.engine.realtime.os_scheduling import ask, raise_priority, trial, words
from pincette.engine.realtime.system import CPU_LATENCY, Linux

ALL = Scheduling(priority=20, cores=(1,), timer_slack_s=2e-6, cpu_latency_s=1e-5, lock_memory=True)
KIB = 1024


def read_tree() -> dict[str, object]:
    return tomllib.loads(Path("deploy/rigs/demo.toml").read_text(encoding="utf-8"))


@dataclass
class Fake(Linux):
    """A system that permits the given settings."""

    permits: frozenset[str] = frozenset(
        {"priority", "niceness", "cores", "slack", "latency", "memory"}
    )
    rtprio: int = 99
    memlock: int | None = None
    has: tuple[int, ...] = (0, 1)
    asked: list[tuple[str, object]] = field(default_factory=list[tuple[str, object]])

    def _ask(self, what: str, value: object) -> None:
        if what not in self.permits:
            raise PermissionError(1, "Operation not permitted")
        self.asked.append((what, value))

    def run_fixed(self, priority: int) -> None:
        self._ask("priority", priority)

    def be_nice(self, niceness: int) -> None:
        self._ask("niceness", niceness)

    def run_on(self, cores: tuple[int, ...]) -> None:
        self._ask("cores", cores)

    def wake_within(self, slack_s: float) -> None:
        self._ask("slack", slack_s)

    def limit_cpu_latency(self, latency_s: float) -> None:
        self._ask("latency", latency_s)

    def lock_memory(self) -> None:
        self._ask("memory", True)

    def priority_limit(self) -> int:
        return self.rtprio

    def memory_limit_bytes(self) -> int | None:
        return self.memlock

    def cores(self) -> tuple[int, ...]:
        return self.has


def test_permitted_settings_are_requested_without_a_report(
    caplog: pytest.LogCaptureFixture,
) -> None:
    system = Fake()
    with caplog.at_level(logging.INFO):
        raise_priority(ALL, system)
    assert system.asked == [
        ("priority", 20),
        ("cores", (1,)),
        ("slack", 2e-6),
        ("latency", 1e-5),
        ("memory", True),
    ]
    assert caplog.messages == []


def test_by_default_neither_processors_nor_memory_are_requested() -> None:
    system = Fake()
    assert ask(Scheduling(), system) == ()
    assert system.asked == [("priority", 10), ("slack", 1e-6)]


def test_without_settings_nothing_is_requested_from_the_system() -> None:
    system = Fake(permits=frozenset())
    assert ask(Scheduling(priority=0, timer_slack_s=0.0), system) == ()


def test_refused_settings_are_reported_in_one_line_with_limits_and_remedies(
    caplog: pytest.LogCaptureFixture,
) -> None:
    system = Fake(permits=frozenset(), rtprio=0, memlock=64 * KIB, has=(0, 3))
    with caplog.at_level(logging.INFO):
        raise_priority(ALL, system)
    (line,) = caplog.messages
    assert "\n" not in line
    for part in (
        "runs without the fixed priority SCHED_FIFO 20 (rtprio limit 0; so a busy machine",
        "and without processors 1 of its own (it may run on 0, 3)",
        "a timer slack of 2 µs (Operation not permitted)",
        "a limit of 10 µs for processors to wake (Operation not permitted)",
        'KERNEL=="cpu_dma_latency"',
        "locked memory (memlock limit 64 KiB, it must be unlimited)",
        "--ulimit rtprio=20 or --cap-add SYS_NICE",
        "LimitMEMLOCK=infinity",
        "--ulimit memlock=-1 or --cap-add IPC_LOCK",
        "--cpuset-cpus",
        "docs/how-to/real-time.md",
    ):
        assert part in line


def test_niceness_replaces_a_refused_priority() -> None:
    system = Fake(permits=frozenset({"niceness"}), rtprio=5)
    (refusal,) = ask(Scheduling(timer_slack_s=0.0), system)
    assert system.asked == [("niceness", -10)]
    assert refusal.words == (
        "the fixed priority SCHED_FIFO 10 (rtprio limit 5; niceness -10 instead)"
    )


def test_a_sufficient_limit_is_not_reported_as_the_cause() -> None:
    (refusal,) = ask(Scheduling(timer_slack_s=0.0), Fake(permits=frozenset(), rtprio=99))
    assert "no share for this control group" in refusal.words
    assert "cpu.rt_runtime_us" in refusal.remedy


def test_missing_processors_are_not_requested() -> None:
    system = Fake()
    (refusal,) = ask(Scheduling(priority=0, cores=(1, 7), timer_slack_s=0.0), system)
    assert refusal.setting == "cores"
    assert system.asked == []


def test_a_required_setting_that_is_refused_prevents_a_start() -> None:
    system = Fake(permits=frozenset({"slack"}), rtprio=0)
    with pytest.raises(ConfigError, match=r"required = priority: does not .*rtprio limit 0"):
        raise_priority(Scheduling(required=frozenset({"priority"})), system)
    raise_priority(Scheduling(required=frozenset({"timer_slack"})), system)


def test_checking_permissions_changes_neither_priority_nor_memory() -> None:
    system = Fake(memlock=8 * KIB)
    (refusal,) = trial(ALL, system)
    assert refusal.setting == "memory"
    assert system.asked == [("cores", (1,)), ("slack", 2e-6), ("latency", 1e-5)]
    assert trial(ALL, Fake()) == ()


def test_a_rig_file_has_settings_for_each_program() -> None:
    realtime = {
        "priority": {"sensor": 30},
        "cores": {"sensor": [1], "actuator": [0, 1]},
        "cpu_latency_s": 0.0,
        "lock_memory": True,
        "required": ["memory"],
    }
    rig = parse_rig({**read_tree(), "realtime": realtime})
    assert rig.realtime.of("sensor") == Scheduling(30, (1,), 1e-6, 0.0, True, frozenset({"memory"}))
    assert rig.realtime.of("actuator").cores == (0, 1)
    composed = rig.realtime.of("sensor", "actuator")
    assert (composed.priority, composed.cores) == (30, (0, 1))
    assert rig.realtime.of("sensor", "controller").cores == ()
    assert rig.realtime.of("router") == Scheduling(10, (), 1e-6, 0.0, True, frozenset({"memory"}))
    assert parse_rig_json(rig.model_dump_json()) == rig
    assert rig.digest() == parse_rig(read_tree()).digest()


@pytest.mark.parametrize(
    ("wish", "why"),
    [
        ({"priority": 100}, "must be 99 or less"),
        ({"priority": {"supervisor": 10}}, "supervisor"),
        ({"cores": [-1]}, "must be 0 or more"),
        ({"timer_slack_s": -1.0}, "must be 0 or more"),
        ({"cpu_latency_s": -1.0}, "must be 0 or more"),
        ({"required": ["speed"]}, "speed"),
        ({"nice": 3}, "nice"),
    ],
)
def test_impossible_settings_are_refused(wish: dict[str, object], why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        parse_rig({**read_tree(), "realtime": wish})


TRY = """
import json, os, struct
from pincette.config.programs import Scheduling
from pincette.engine.realtime.os_scheduling import ask
from pincette.engine.realtime.system import CPU_LATENCY, Linux

system = Linux()
core = system.cores()[-1]
wished = Scheduling(cores=(core,), timer_slack_s=3e-6, cpu_latency_s=1e-4, lock_memory=True)
found = ask(wished, system)
latency_us = None
if "cpu_latency" not in [one.setting for one in found]:
    with open(CPU_LATENCY, "rb") as device:
        (latency_us,) = struct.unpack("=i", device.read(4))
with open("/proc/self/status") as status:
    locked = [line.split()[1] for line in status if line.startswith("VmLck")]
with open(f"/proc/{os.getpid()}/timerslack_ns") as slack:
    slack_ns = int(slack.read())
print(json.dumps({
    "refused": [one.setting for one in found],
    "words": [one.words for one in found],
    "policy": os.sched_getscheduler(0),
    "fifo": os.SCHED_FIFO,
    "alone": system.cores() == (core,),
    "slack_ns": slack_ns,
    "latency_us": latency_us,
    "locked_kB": int(locked[0]),
    "rtprio": system.priority_limit(),
    "memlock": system.memory_limit_bytes(),
}))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the calls are Linux's")
def test_a_real_request_is_granted_or_refused_according_to_the_system_limits() -> None:
    """The applied settings are the reported ones, whatever this machine permits."""
    done = subprocess.run([sys.executable, "-c", TRY], capture_output=True, text=True, check=True)
    output = json.loads(done.stdout)
    assert set(output["refused"]) <= {"priority", "cpu_latency", "memory"}, output["words"]
    assert output["alone"]
    if output["policy"] != output["fifo"]:
        assert "priority" in output["refused"]
        assert output["slack_ns"] == 3000
    else:
        assert "priority" not in output["refused"]
    assert ("cpu_latency" in output["refused"]) == (not os.access(CPU_LATENCY, os.W_OK))
    if "cpu_latency" not in output["refused"]:
        assert output["latency_us"] <= 100
    assert ("memory" in output["refused"]) == (output["locked_kB"] == 0)
    if output["memlock"] is not None:
        assert "memory" in output["refused"]


@pytest.mark.skipif(sys.platform != "linux", reason="the calls are Linux's")
def test_reported_limits_are_those_of_the_process() -> None:
    system = Linux()
    assert system.priority_limit() >= 0
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
    assert system.memory_limit_bytes() in (None, limit)
    assert words(ask(Scheduling(priority=0, cores=(1023,), timer_slack_s=0.0), system)).startswith(
        "processors 1023"
    )
