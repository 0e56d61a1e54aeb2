"""The questions that a service takes, noted for the record with where among its steps they came."""

from typing import Any

from pincette.messages import Act, Arm, Asked, Load, Message, Reset, Sample, Trip
from pincette.runtime.carried import told
from pincette.service import AnyService
from pincette.topics import TOPIC_OF


class Notes:
    """What one service was asked."""

    def __init__(self, service: AnyService) -> None:
        self._service = service
        self._load: Load | None = None
        """What the next arming plays."""
        self.newest: Sample | None = None
        """The sample that the service stepped with last."""

    def taken(self, request: Message, config: Any, state: Any) -> tuple[Asked, ...]:
        """Note a question that was taken; ``config`` and ``state`` are those after it.

        A program is noted with its arming, since it belongs to that epoch.
        """
        match request:
            case Load():
                self._load = request
            case Arm():
                carried = told(self._service, config, state)
                armed = self._asked(state, arm=request, carried=carried)
                loaded = () if self._load is None else (self._asked(state, load=self._load),)
                return *loaded, armed
            case Act():
                return (self._asked(state, act=request),)
            case Trip():
                return (self._asked(state, trip=request),)
            case Reset():
                return (self._asked(state, reset=request),)
            case _:
                pass
        return ()

    def _asked(self, state: Any, **question: Any) -> Asked:
        sample = self.newest
        if sample is not None and sample.epoch != state.epoch:
            sample = None  # of the epoch before
        return Asked(
            epoch=state.epoch,
            seq=-1 if sample is None else sample.seq,
            service=self._service.name,
            topic="" if sample is None else TOPIC_OF[type(sample)].name,
            **question,
        )
