"""Pairs of random arms, each taught by itself, and the part between them."""

from dataclasses import dataclass

import numpy as np

from pincette.config import RigFile, derived
from pincette.control.arm.plant import ArmParameters, consistent_arm
from pincette.control.response.hysteresis import HysteresisModel
from pincette.sim.plant.pair_state import PairParameters
from pincette.sim.plant.plant import plant_parameters
from pincette_study.beyond.tracks import CLASSES, REACH_UM
