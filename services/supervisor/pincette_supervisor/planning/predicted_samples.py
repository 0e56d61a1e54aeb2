"""What is predicted, sample by sample."""

from dataclasses import dataclass, field, replace

from pincette.control.laws.two_arms import Pair
from pincette.core.messages import Telemetry


@dataclass(slots=True)
class SecondSamples:
    """What is predicted of the second arm, and of the part between both; lists of one length."""

    x_um: list[float] = field(default_factory=list[float])
    force_mN: list[float] = field(default_factory=list[float])
    asked_V: list[float] = field(default_factory=list[float])
    voltage_V: list[float] = field(default_factory=list[float])
    place_um: list[float] = field(default_factory=list[float])
    """q = (x_1 - x_2)/2, and"""
    place_r_um: list[float] = field(default_factory=list[float])
    """its reference."""

    def add(self, tips_um: Pair, force_mN: float, voltages_V: Pair, place_r_um: float) -> None:
        """Add a sample, as ``Samples.add``."""
        x_1, x_2 = tips_um
        self.x_um.append(x_2)
        self.force_mN.append(force_mN)
        self.asked_V.append(voltages_V[0])
        self.voltage_V.append(voltages_V[1])
        self.place_um.append(0.5 * (x_1 - x_2))
        self.place_r_um.append(place_r_um)


@dataclass(slots=True)
class Samples:
    """What is predicted, sample by sample; lists of one length."""

    t_s: list[float] = field(default_factory=list[float])
    phase: list[str] = field(default_factory=list[str])
    x_um: list[float] = field(default_factory=list[float])
    force_mN: list[float] = field(default_factory=list[float])
    """Of the contact, compressive and positive."""
    asked_V: list[float] = field(default_factory=list[float])
    """By the controller; the actuator's limits may keep the voltage from it."""
    voltage_V: list[float] = field(default_factory=list[float])
    """As it is applied."""
    x_r_um: list[float] = field(default_factory=list[float])
    force_r_mN: list[float] = field(default_factory=list[float])
    sliding_um: list[float] = field(default_factory=list[float])
    band_um: list[float] = field(default_factory=list[float])
    second: SecondSamples | None = None
    """Of the second arm, where there is one."""

    def of_arms(self) -> "list[Samples]":
        """The samples of each arm as if it were the only one."""
        if self.second is None:
            return [self]
        second = replace(
            self,
            x_um=self.second.x_um,
            force_mN=self.second.force_mN,
            asked_V=self.second.asked_V,
            voltage_V=self.second.voltage_V,
            second=None,
        )
        return [replace(self, second=None), second]

    def add(
        self, t_s: float, x_um: float, force_mN: float, voltages_V: Pair, told: Telemetry
    ) -> None:
        """Add a sample: voltage asked for and applied, and what the controller has told of it."""
        self.t_s.append(t_s)
        self.phase.append(told.phase)
        self.x_um.append(x_um)
        self.force_mN.append(force_mN)
        self.asked_V.append(voltages_V[0])
        self.voltage_V.append(voltages_V[1])
        self.x_r_um.append(told.arms[0].x_r_um)
        self.force_r_mN.append(told.force_r_mN)
        self.sliding_um.append(told.sliding_um)
        self.band_um.append(told.band_um)
