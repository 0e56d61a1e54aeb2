"""What is drawn for one rig of the campaign: an arm, its surroundings, and what happens to it.

quantity                              from     to      drawn for
class of hysteresis                   relays, plays or Bouc-Wen
relays far from saturation                             a half of the relays
loop at 2 V peak to peak              5 %      45 %
gain from -0.5 to 3 V, µm/V           16       22
output lag, ms                        0        5
delay of the output, ms               2        8
sensor noise, µm r.m.s.               0.02     0.15    log-uniform
drift, µm/min                         0        1       steepest; its cycle 20 to 60 min
creep per decade                      0.8 %    2 %
stiffness over the plan               0.3      3       each grip after the first; log-uniform
gain changed by up to                 5 %              a third: amplifier, piezo or sensor
programs restarted                                     a third; the arm lives on
part slips by 1 to 10 µm                               a tenth, at 40 to 90 % of the force
part presses the arm at its rest                       a tenth, by 1 to 12 µm
"""

from dataclasses import dataclass
from math import exp, log, pi
from typing import Literal

import numpy as np

from pincette.config import RigFile, parse_rig, read_rig
from pincette.config.reading import laid_over
from tests.support.campaign.arm import Arm, Part
from tests.support.campaign.hysteresis import CLASSES, Class, drawn
from tests.support.rigs import DEMO, Tree

BASE = DEMO.with_name("bring-up.toml")
CAMPAIGN = 0xCA4A16
"""Constant part of every seed, so that no rig is one on which the product was tuned."""
FORCES_MN = (5.0, 20.0)
TRAVEL: Tree = {"position_min_um": -60.0, "position_max_um": 110.0}
"""Travel of an arm whose gain is not known when its rig file is written."""
Gain = Literal["amplifier", "piezo", "sensor"]
GAINS: tuple[Gain, ...] = ("amplifier", "piezo", "sensor")


@dataclass(frozen=True)
class GripWish:
    """One grip, and the events before or during it."""

    force_mN: float
    stiffness_share: float
    """Stiffness of the part divided by the planned one."""
    profile: Literal["quick", "gentle"]
    contact_off_um: float
    """Offset of the part's position from the planned one, in µm."""
    gain: tuple[Gain, float] | None = None
    """Gain that changes just before the grip, and its factor."""
    restart_s: float | None = None
    """Rest after which all programs are started again before the grip; None: no restart."""
    slip: tuple[float, float] | None = None
    """Share of the force above which the part slips, and the distance in µm."""
    presses_um: float | None = None
    """Distance by which the part presses the resting arm, in µm; None if it lies where planned."""

    @property
    def undisturbed(self) -> bool:
        """Return whether no event happened that is unknown to the person."""
        return self.gain is None and self.slip is None and self.presses_um is None


@dataclass(frozen=True)
class Drawn:
    """One rig of the campaign."""

    seed: int
    kind: Class
    far: bool
    """Whether relays are far from saturation."""
    loop_share: float
    noise_um: float
    drift_um_per_min: float
    lag_s: float
    stiffness_mN_per_um: float
    """Stiffness of the part with which the rig is brought up."""
    contact_um: float
    rig: RigFile
    arm: Arm
    grips: tuple[GripWish, ...]

    def planned_part(self) -> Part:
        """Return the part with which the rig is brought up."""
        return Part(self.contact_um, self.stiffness_mN_per_um)

    @property
    def label(self) -> str:
        """Return a short description of the rig."""
        far = ", far" if self.far else ""
        return (
            f"rig {self.seed}, {self.kind}{far}, loop {100.0 * self.loop_share:.0f} %, "
            f"noise {self.noise_um:.3f} µm, lag {1e3 * self.lag_s:.1f} ms"
        )


def draw(seed: int) -> Drawn:
    """Draw the rig of a seed."""
    chance = np.random.default_rng((CAMPAIGN, seed))

    def between(low: float, high: float) -> float:
        return float(chance.uniform(low, high))

    kind = CLASSES[seed % len(CLASSES)]
    far = kind == "relays" and bool(chance.random() < 0.5)
    hysteresis, stroke, width = drawn(kind, between(0.05, 0.45), chance, far=far)
    noise_um = exp(between(log(0.02), log(0.15)))
    drift_um_per_min = between(0.0, 1.0)
    base = read_rig(BASE)
    arm = Arm(
        hysteresis=hysteresis,
        gain_um_per_V=between(16.0, 22.0) * 3.5 / stroke,
        compliance_um_per_mN=0.46 * between(0.85, 1.15),
        omega_per_s=2.0 * pi * 388.0 * between(0.9, 1.1),
        damping=between(0.015, 0.04),
        creep_per_decade=between(0.008, 0.02),
        lag_s=between(0.0, 5e-3),
        delay_s=between(2e-3, 8e-3),
        noise_um=noise_um,
        drift_um_per_s=drift_um_per_min / 60.0,
        drift_cycle_s=between(1200.0, 3600.0),
        period_s=base.rig.period_s,
        seed=seed,
    )
    assert base.simulation is not None
    changes: Tree = {
        "rig": {"time": "lockstep", "name": f"campaign-{seed}"},
        "sensor": {"noise_um": noise_um, "drift_um_per_min": drift_um_per_min},
        "limits": TRAVEL,
    }
    tree = base.model_dump(mode="json", exclude_unset=True)
    rig = parse_rig(laid_over(tree, changes))
    return Drawn(
        seed=seed,
        kind=kind,
        far=far,
        loop_share=width,
        noise_um=noise_um,
        drift_um_per_min=drift_um_per_min,
        lag_s=arm.lag_s,
        stiffness_mN_per_um=2.17 * between(0.9, 1.1),
        contact_um=30.0 + between(-2.0, 2.0),
        rig=rig,
        arm=arm,
        grips=tuple(_grips(chance)),
    )


def _grips(chance: np.random.Generator) -> list[GripWish]:
    """Draw two undisturbed grips, one of them with the planned part, then one or two with
    events."""

    def between(low: float, high: float) -> float:
        return float(chance.uniform(low, high))

    def wish(share: float, **events: object) -> GripWish:
        profile: Literal["quick", "gentle"] = "quick" if chance.random() < 0.5 else "gentle"
        return GripWish(between(*FORCES_MN), share, profile, between(-2.0, 2.0), **events)  # pyright: ignore[reportArgumentType]

    def share() -> float:
        return exp(between(log(0.3), log(3.0)))

    grips = [wish(1.0), wish(share())]
    if chance.random() < 1 / 3:
        grips.append(wish(1.0, restart_s=exp(between(log(5.0), log(3600.0)))))
    if chance.random() < 0.1:
        grips.append(wish(share(), slip=(between(0.4, 0.9), exp(between(0.0, log(10.0))))))
    if chance.random() < 0.1:
        grips.extend([wish(1.0, presses_um=between(1.0, 12.0))] * 2)
    if chance.random() < 1 / 3:
        name = GAINS[int(chance.integers(len(GAINS)))]
        change = between(0.005, 0.05) * (1.0 if chance.random() < 0.5 else -1.0)
        grips.append(wish(1.0, gain=(name, 1.0 + change)))
    return grips
