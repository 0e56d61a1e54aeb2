"""`pincette topics`: the keys of a rig."""

from pathlib import Path

from pincette.cli.rig_file import opened
from pincette.topics import QUESTIONS, TOPICS, key, question_key


def topics(rig_path: Path) -> int:
    """List what is published and what is answered, a key a line."""
    name = opened(rig_path).rig.name
    print("published, a MessagePack map a sample, units in the field names:")
    _lines([(key(name, topic), f"{topic.message.__name__:<9}", topic.summary) for topic in TOPICS])
    print("\nasked, with request and reply:")
    _lines(
        [
            (
                question_key(name, question),
                f"{question.request.__name__} → {question.reply.__name__}",
            )
            for question in QUESTIONS
        ]
    )
    return 0


def tree(rig_path: Path) -> dict[str, list[dict[str, str]]]:
    """The same as plain data."""
    name = opened(rig_path).rig.name
    return {
        "published": [
            {
                "key": key(name, topic),
                "message": topic.message.__name__,
                "producer": topic.producer,
                "summary": topic.summary,
            }
            for topic in TOPICS
        ],
        "asked": [
            {
                "key": question_key(name, question),
                "request": question.request.__name__,
                "reply": question.reply.__name__,
                "summary": question.summary,
            }
            for question in QUESTIONS
        ],
    }


def _lines(rows: list[tuple[str, ...]]) -> None:
    width = max(len(first) for first, *_ in rows)
    for first, *others in rows:
        print("  " + "  ".join([first.ljust(width), *others]))
