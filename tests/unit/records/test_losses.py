"""Samples that are known to be missing."""

from pincette.core.messages import Applied, Command, Estimate, Message, Position
from pincette.records.tables import lost
from tests.support.recorded import loop


def _without(kind: type[Message], *seqs: int) -> list[Message]:
    return [
        item for item in loop(10) if not (type(item) is kind and getattr(item, "seq", 0) in seqs)
    ]


def test_a_complete_record_has_no_losses() -> None:
    assert lost(loop(10)) == {}


def test_missing_sources_of_derived_messages_are_counted() -> None:
    assert lost(_without(Position, 3, 4)) == {"position": 2}
    assert lost(_without(Estimate, 5)) == {"estimate": 1}
    assert lost(_without(Command, 7)) == {"command": 1}
    assert lost(_without(Applied, 2)) == {"applied": 1}


def test_a_tick_without_any_message_is_not_counted_as_lost() -> None:
    def seen(message: Message) -> bool:
        return getattr(message, "seq", 0) < 6

    assert lost([item for item in loop(10) if seen(item)]) == {}
