"""`pincette topics`: the keys of a rig."""

from pathlib import Path

from rich.console import Console
from rich.table import Table

from pincette.cli.rest import CliError
from pincette.config import ConfigError, read_rig
from pincette.topics import QUESTIONS, TOPICS, key, question_key


def topics(rig_path: Path) -> int:
    """List what is published and what is answered, with the keys to use."""
    try:
        rig = read_rig(rig_path).rig
    except ConfigError as error:
        raise CliError(str(error)) from error
    console = Console(highlight=False, soft_wrap=True)
    published = Table("key", "from", "message", "what", title="published", title_justify="left")
    for topic in TOPICS:
        published.add_row(
            key(rig.name, topic), topic.producer, topic.message.__name__, topic.summary
        )
    asked = Table("key", "request", "reply", "what", title="answered", title_justify="left")
    for question in QUESTIONS:
        asked.add_row(
            question_key(rig.name, question),
            question.request.__name__,
            question.reply.__name__,
            question.summary,
        )
    console.print(published)
    console.print(asked)
    console.print("Every payload is a MessagePack map; units are in the field names.")
    return 0
