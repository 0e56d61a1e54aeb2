"""The search for gains has the same numbers compiled, on any number of processes."""

from dataclasses import replace

import pytest

from pincette.config import gains
from pincette.control.laws.definition import LawSettings
from pincette.control.response.free_response import FreeSample, nominal_response
from pincette.control.stability.tuning import TuningPath, TuningRig, track_each
from pincette_batch.tuning import compiled_tracks, tracks_on
from tests.support.laws import default_settings
from tests.support.rigs import demo_rig

SIDES = [(2.2, 0.1, 1.0), (2.1, -0.1, 1.05)]


def posed() -> tuple[TuningRig, TuningPath]:
    rig = demo_rig()
    path = gains._path(rig)  # pyright: ignore[reportPrivateUsage]
    samples = len(path.force_r_mN)
    return gains._tuning_rig(rig, samples, "identified"), path  # pyright: ignore[reportPrivateUsage]


def laws(scheme: str) -> list[LawSettings]:
    start = default_settings(scheme, "consistent")
    swept = [start.with_gains(K_P=K_P, K_f=K_f) for K_P in (0.2, 2.0) for K_f in (0.0, 5000.0)]
    return [
        *swept,
        start.with_gains(K_S=0.1),
        default_settings(scheme, "printed"),
        default_settings(scheme, "identified"),
    ]


@pytest.mark.parametrize("scheme", ["pbsmic", "dsmifc"])
@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_compiled_tracks_have_the_same_bits(scheme: str, delay: float) -> None:
    rig, path = posed()
    rig = replace(rig, delay_s=delay * rig.period_s)
    found = [list(each) for each in compiled_tracks(rig, path, laws(scheme), SIDES)]
    assert found == [list(each) for each in track_each(rig, path, laws(scheme), SIDES)]


def test_a_straight_line_is_played_as_it_is() -> None:
    rig, path = posed()
    line = nominal_response(19.0, FreeSample(1.5, 30.0)).follow(1.5, rig.period_s)
    straight, some = replace(rig, response=line), laws("pbsmic")[:2]
    found = list(compiled_tracks(straight, path, some, SIDES))
    assert found == list(track_each(straight, path, some, SIDES))


def test_processes_tell_of_their_progress_and_keep_the_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pincette_batch.tuning.CHUNK", 2)
    rig, path = posed()
    told: list[tuple[int, int]] = []
    play = tracks_on(2, lambda done, there: told.append((done, there)))
    found = list(play(rig, path, laws("pbsmic"), SIDES))
    assert found == list(compiled_tracks(rig, path, laws("pbsmic"), SIDES))
    assert told == [(2, 7), (4, 7), (6, 7), (7, 7)]


def test_too_short_a_path_is_refused_as_ever() -> None:
    rig, path = posed()
    with pytest.raises(ValueError, match="too few"):
        list(compiled_tracks(rig, replace(path, settled=10_000), laws("pbsmic"), SIDES))


def test_no_process_is_refused() -> None:
    with pytest.raises(ValueError, match="workers = 0"):
        tracks_on(0)
