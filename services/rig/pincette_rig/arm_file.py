"""File that stores the simulated arm while its program does not run.

A real arm keeps its hysteresis over a restart of the programs, and its creep continues. The rig
program writes the state of the simulated arm twice a second from a separate thread, and the next
start resumes from it. The loop never waits for the disk.
"""

import hashlib
import logging
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from pincette.config import RigFile
from pincette.control.record import FrozenRecord
from pincette.core.files import DRAFT, make_folder, replace_file
from pincette.engine.threads import RepeatedAction
from pincette.sim.plant.state import PlantState
from pincette.sim.rig.pair_rig import SimulatedPair
from pincette.sim.rig.rig import SimulatedRig

log = logging.getLogger(__name__)
SAVE_S = 0.5
STARTING_S = 1.0
"""Smallest time that is simulated for the arm between two starts, in s."""
CLOSE_S = 2.0


class SavedArm(FrozenRecord, frozen=True):
    """State of the simulated arm or arms at one time."""

    hysteresis: str
    """Digest of the hysteresis in the rig file; a state is invalid for another digest."""
    saved_s: float
    """Time of the save, as Unix time in s."""
    arms: tuple[PlantState, ...]


class ArmFile:
    """Restores the arm of a rig from its file, then keeps the file up to date until closed."""

    def __init__(
        self,
        rig_file: RigFile,
        data: Path,
        rig: SimulatedRig | SimulatedPair,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._path = rig_file.simulated_arm(data)
        self._hysteresis = _digest(rig_file)
        self._lockstep = rig_file.lockstep
        self._rig, self._clock = rig, clock
        self._saved: tuple[PlantState, ...] = ()
        self._action = RepeatedAction("simulated-arm", SAVE_S, self.save)

    def start(self) -> None:
        """Resume the saved arm, if there is one, and begin to save it; raises OSError."""
        make_folder(self._path.parent)
        for draft in self._path.parent.glob(f"{self._path.name}.*{DRAFT}"):
            draft.unlink(missing_ok=True)
        saved = self._read()
        if saved is not None:
            away_s = STARTING_S
            if not self._lockstep:  # in lockstep only voltages advance simulated time
                away_s = max(away_s, self._clock() - saved.saved_s)
            self._rig.resume(saved.arms, away_s)
        self.save()
        self._action.start()

    def close(self) -> None:
        """Save for the last time, and end the thread."""
        self._action.close(CLOSE_S)
        try:
            self.save()
        except OSError as error:
            log.warning("the simulated arm is not saved: %s", error)

    def save(self) -> None:
        """Replace the file if the arm has changed; raises OSError."""
        arms = self._rig.arm_states()
        if arms == self._saved:
            return
        saved = SavedArm(self._hysteresis, self._clock(), arms)
        replace_file(self._path, msgspec.json.encode(saved))
        self._saved = arms

    def _read(self) -> SavedArm | None:
        try:
            saved = msgspec.json.decode(self._path.read_bytes(), type=SavedArm)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.MsgspecError) as error:
            log.warning("%s cannot be read (%s): a new arm is simulated", self._path, error)
            return None
        if saved.hysteresis != self._hysteresis:
            log.warning("the hysteresis in the rig file has changed: a new arm is simulated")
            return None
        return saved


def _digest(rig_file: RigFile) -> str:
    """Return the digest of the settings that determine the memory of each arm."""
    tables = [arm.simulation or rig_file.simulation for arm in rig_file.arms]
    kept = {"hysteresis", "relays"}
    texts = [one.model_dump_json(include=kept) for one in tables if one is not None]
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]
