"""A sensor that shows the same reading while the voltage moves: pure, a sample at a time.

Noise makes a laser's readings differ even at rest, but a coarse display may hide it, so a constant
reading alone says nothing. It does where the arm was meant to move by much more than the noise.
"""

from dataclasses import dataclass

SAMPLES = 8
"""Equal readings in a row; with the age limit of a command the actuator trips at the tenth."""
LATE_SAMPLES = 2
"""The newest voltages, which output, arm and averaging may not have made visible yet."""
NOISES = 10.0
"""Motion that cannot stay unseen, in standard deviations of the sensor's noise."""


def moved_V(noise_um: float, piezo_um_per_V: float) -> float:
    """Change of the voltage, in V, that a free arm answers by ``NOISES`` of noise.

    Without noise nothing is known of what the sensor resolves, and the answer is infinite.
    """
    return NOISES * noise_um / piezo_um_per_V if noise_um > 0.0 else float("inf")


@dataclass(frozen=True, slots=True)
class StuckWatch:
    """The last reading, and the voltages applied since it has been the same, at most ``SAMPLES``.

    Creep is why no older ones count: a loop that holds the arm still moves the voltage slowly.
    """

    x_um: float | None = None
    voltages_V: tuple[float, ...] = ()
    stuck: bool = False

    def follow(self, x_um: float, voltage_V: float, moved_V: float) -> "StuckWatch":
        """Take a sample and the voltage behind it; once stuck, until the reading differs."""
        if x_um != self.x_um:
            return StuckWatch(x_um, (voltage_V,))
        voltages_V = (*self.voltages_V[1 - SAMPLES :], voltage_V)
        settled_V = voltages_V[:-LATE_SAMPLES]
        stuck = self.stuck or (
            len(voltages_V) == SAMPLES and max(settled_V) - min(settled_V) > moved_V
        )
        return StuckWatch(x_um, voltages_V, stuck)

    @property
    def words(self) -> str:
        """What a person is told; empty where all is well."""
        if not self.stuck:
            return ""
        return f"sensor stuck: {self.x_um:.3f} µm in {SAMPLES} samples while the voltage moved"
