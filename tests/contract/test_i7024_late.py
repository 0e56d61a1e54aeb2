"""An I-7024 whose replies are so late that each is mistaken for the reply to the next request."""

from pincette.instruments.icpdas_i7024 import I7024, I7024Options
from pincette.instruments.line.memory_link import MemoryLink
from pincette.sim.instruments.dcon import SimulatedI7024


class LateLink:
    """Return to each request the reply to the previous one, as a slow module does."""

    def __init__(self, link: MemoryLink) -> None:
        self._link = link
        self.late: list[bytes] = []

    def exchange(self, request: bytes) -> bytes:
        self.late.append(self._link.exchange(request))
        return self.late.pop(0)

    def tell(self, line: bytes) -> None:
        self._link.tell(line)

    def close(self) -> None:
        self._link.close()


def test_a_reset_succeeds_despite_a_late_answer_to_an_earlier_write() -> None:
    now_s = 0.0
    voltages_V: list[float] = []
    module = SimulatedI7024(voltages_V.append, lambda: now_s)
    link = LateLink(MemoryLink(module.answer))
    output = I7024(I7024Options(), lambda _on_open: link)
    output.write_V(0.5)
    now_s = 1.0
    module.idle()
    assert module.tripped
    link.late = [b"!"]  # the late reply belongs to a write that is no longer waited for
    output.clear_trip()
    assert not module.tripped
    assert output.read_V() == voltages_V[-1]
