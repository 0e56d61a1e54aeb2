"""Actions of a person who brings a rig up: calibrations over REST, and manual work at the
simulated bench."""

from dataclasses import dataclass
from time import monotonic, sleep

from pincette.bus.topology import client_session
from pincette.bus.zenoh_bus import ZenohBus
from pincette.core.messages import SimCommand
from pincette.core.topics import SIM_COMMAND
from tests.support.running import Json, RunningRig

LOOK_S = 0.02
JOB_S = 300.0
ENDS = ("succeeded", "stopped", "aborted", "failed", "interrupted")


@dataclass
class Technician:
    """Calls the rig's REST interface, places and removes the part, hangs weights."""

    rig: RunningRig
    bus: ZenohBus

    @classmethod
    def at(cls, rig: RunningRig) -> "Technician":
        """Connect to a running rig."""
        file = rig.rig
        return cls(
            rig, ZenohBus(client_session(file.bus.host, file.bus.port), file.rig.name, "hand")
        )

    def leave(self) -> None:
        """Disconnect."""
        self.bus.close()

    def do(self, target: str, what: str, value: float | None = None) -> None:
        """Do something at the bench."""
        self.bus.call(SIM_COMMAND, SimCommand(target, what, value))

    def calibrate(self, kind: str, **wishes: object) -> Json:
        """Run one calibration to its end and accept its proposal; returns the proposal."""
        body: Json = {"kind": "calibrate", "calibration": kind, "autostart": True, **wishes}
        name = str(self.rig.post("/jobs", body).raise_for_status().json()["id"])
        job = self.attend(name)
        assert job["state"] == "succeeded", f"{kind}: {job['state']}, {job['cause']}"
        self.do("weight", "hang", 0.0)
        answer = self.rig.post(f"/calibrations/{name}/actions", {"type": "accept"})
        return dict(answer.raise_for_status().json())

    def attend(self, name: str) -> Json:
        """Do what the job requests of a person, until it has ended and its record is written."""
        deadline = monotonic() + JOB_S
        while monotonic() < deadline:
            job = self.rig.job(name)
            if job["state"] in ENDS:
                return self.rig.ended(name)
            if "continue" in job["allowed_actions"]:
                progress: Json = job["progress"]
                self.do("weight", "hang", float(progress["weight_mN"]))
                self.rig.post(f"/jobs/{name}/actions", {"type": "continue"}).raise_for_status()
            sleep(LOOK_S)
        raise TimeoutError(f"{name} did not end within {JOB_S:g} s: {self.rig.job(name)}")
