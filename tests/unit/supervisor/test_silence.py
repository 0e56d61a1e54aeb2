"""How long a rig has been silent, to one who may itself have stood still."""

from pincette_supervisor.running.silence import LOOK_COUNTS_S, Silence


class Clock:
    """A clock that a test turns."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def read(self) -> float:
        return self.now_s


def test_silence_lasts_from_look_to_look_until_somebody_speaks() -> None:
    clock = Clock()
    silence = Silence(clock.read)
    for _ in range(60):
        clock.now_s += 0.02
        silence.look(heard=False)
    assert abs(silence.lasts_s - 1.2) < 1e-9
    clock.now_s += 0.02
    silence.look(heard=True)
    assert silence.lasts_s == 0.0


def test_who_stood_still_has_heard_nothing_meanwhile() -> None:
    clock = Clock()
    silence = Silence(clock.read)
    clock.now_s += 3600.0
    silence.look(heard=False)
    assert silence.lasts_s == LOOK_COUNTS_S
