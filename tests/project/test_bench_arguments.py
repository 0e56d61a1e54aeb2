"""A bench with invalid arguments reports the wrong number, its limit and a valid value."""

import pytest

from tests.bench.loop.__main__ import LEAST_TICKS, main
from tests.bench.loop.watch import WARM_UP, Stopwatch


@pytest.mark.parametrize("ticks", ["300", "301", "0", "-1"])
def test_a_block_shorter_than_its_warm_up_is_refused_with_limit_and_remedy(
    ticks: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--ticks", ticks])
    assert ended.value.code == 2
    output = capsys.readouterr().err
    assert f"--ticks = {ticks}: the limit is {LEAST_TICKS}" in output
    assert "give --ticks 2000" in output
    assert "Traceback" not in output


def test_a_number_of_blocks_below_1_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--blocks", "0"])
    assert "--blocks = 0: the limit is 1" in capsys.readouterr().err


def test_the_minimum_number_of_ticks_leaves_one_tick_to_count() -> None:
    watch = Stopwatch(lambda _line: None)
    for _ in range(LEAST_TICKS):
        watch.answer(b"MS,01")
    assert len(watch.ticks_s()) == LEAST_TICKS - 1 - WARM_UP == 1
