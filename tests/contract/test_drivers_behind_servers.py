"""The contract of each driver through real device servers: ser2net and socat."""

from collections.abc import Iterator
from contextlib import ExitStack
from itertools import count
from pathlib import Path

import pytest

from pincette.instruments.protocols import Link
from pincette.sim.instruments.protocol import TERMINATOR, Instrument
from pincette.sim.wires.wire import serve
from tests.contract.conftest import Reach
from tests.contract.test_position_sensor import TestKeyenceMicrometres
from tests.contract.test_voltage_output import TestDC205, TestI7024
from tests.support.device_servers import ser2net, socat

pytestmark = pytest.mark.usefixtures("stalls")

__all__ = ["TestDC205", "TestI7024", "TestKeyenceMicrometres"]


@pytest.fixture
def reach(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Reach]:
    """Offer an instrument at a pseudo-terminal behind a device server: the I-7024 behind socat."""
    start = socat if isinstance(request.instance, TestI7024) else ser2net
    numbers = count()
    with ExitStack() as running:

        def offer(
            instrument: Instrument, terminator: bytes = TERMINATOR
        ) -> tuple[str, Link | None]:
            folder = tmp_path / str(next(numbers))
            folder.mkdir()
            wire = serve(str(folder / "tty"), instrument, terminator=terminator)
            running.enter_context(wire)
            return running.enter_context(start(wire.url, folder)).url, None

        yield offer
