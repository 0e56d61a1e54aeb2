"""Feature SecondArm: data of the second arm of a rig with two driven arms."""

from queue import Queue
from typing import NamedTuple

from sila2.server import FeatureImplementationBase, MetadataDict, SilaServer

from pincette.client import LiveSample


class SecondSample(NamedTuple):
    """Sample of the second arm; the fields are those of the feature definition."""

    Position: float
    Force: float
    Voltage: float
    Place: float


class SecondArm(FeatureImplementationBase):
    """Publishes the newest sample of the second arm; moves nothing."""

    def __init__(self, parent_server: SilaServer) -> None:
        super().__init__(parent_server)
        self._ContactForce_producer_queue: Queue[SecondSample] = Queue()

    def tell(self, one: LiveSample) -> None:
        """Send the sample to subscribers if it is complete."""
        x_um, force_mN, voltage_V = one.second_x_um, one.second_force_mN, one.second_voltage_V
        if x_um is None or force_mN is None or voltage_V is None or one.place_um is None:
            return
        self._ContactForce_producer_queue.put(SecondSample(x_um, force_mN, voltage_V, one.place_um))

    def ContactForce_on_subscription(self, *, metadata: MetadataDict) -> None:
        """Return None, so that all subscribers share one queue."""
