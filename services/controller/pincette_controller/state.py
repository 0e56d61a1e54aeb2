"""Inputs of the controller, and its state between samples."""

from typing import Any

from msgspec.structs import replace

from pincette.control.planning.program import Program
from pincette.control.record import FrozenRecord
from pincette.control.safety.monitors import Watches
from pincette.core.faults import Fault
from pincette.core.messages import Action, Command, Estimate, Telemetry
from pincette_controller.actions import RunningLease
from pincette_controller.arm_memory import ArmMemory
from pincette_controller.control_laws import ControlLaw
from pincette_controller.learning import Learning
from pincette_controller.outputs import invalid_command, number_out_of_bounds
from pincette_controller.player_state import Player


class Inputs(FrozenRecord, frozen=True):
    """The estimate of the newest sample."""

    estimate: Estimate | None


class State(FrozenRecord, frozen=True):
    """The running program, its position, and the memories of law and arms."""

    memories: tuple[ArmMemory, ...]
    """Memory of each arm; it persists over an arming, as the arm's own memory does."""
    watches: tuple[Watches, ...]
    """State of the check of each arm's hard limits."""
    epoch: int = 0
    owner: int = 0
    seq: int = -1
    loaded: Program | None = None
    """Program of the next arming; loading it does not affect the program that plays."""
    program: Program | None = None
    playing: bool = False
    laws: tuple[ControlLaw, ...] = ()
    """Laws of ``program``."""
    player: Player | None = None
    law_state: Any = None
    """State of the law that moves the arms; None before the first step."""
    learning: Learning | None = None
    """Learning over the cycles of a path; None if the program learns nothing."""
    pending: tuple[Action, ...] = ()
    lease: RunningLease | None = None
    """Lease of the program; without a lease it plays to its end, with or without a supervisor."""
    silenced: Fault | None = None
    """Reason why the controller stopped sending commands, although no action has ended the
    program."""
    refused: int = 0
    found: Fault | None = None
    """Reason why the program stops, or has stopped, without a request."""

    @property
    def findings(self) -> tuple[Fault, ...]:
        """Faults of this program that are reported."""
        return () if self.found is None else (self.found,)


def ended_tick(
    state: State,
    player: Player,
    pending: tuple[Action, ...],
    command: Command,
    telemetry: Telemetry,
    estimate: Estimate,
    **changes: Any,
) -> tuple[State, tuple[Command] | tuple[Command, Telemetry]]:
    """Return the state after a tick, and the messages of the controller.

    If a decoder would reject a number of the law, the command is invalid and no telemetry is sent.

    Parameters
    ----------
    changes
        Other fields of the state that the tick has changed.
    """
    fault = number_out_of_bounds(telemetry)
    if fault and command.valid:
        command = invalid_command(command, estimate, fault, known=True)
    state = replace(
        state,
        seq=estimate.seq,
        playing=command.valid and not player.ended,
        player=player,
        pending=pending if command.valid else (),
        **changes,
    )
    if not command.valid:
        state = replace(state, silenced=command.fault, found=command.fault)
    return state, (command,) if fault else (command, telemetry)
