"""Write the data sheet of the demo rig, measured in virtual time: ``make demo-sheet``."""

from datetime import UTC, datetime
from pathlib import Path

from pincette import __version__
from pincette.api.job_kinds import job_kinds
from pincette.config import RigFile, read_rig
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.characterise import CharacteriseJobRequest, CharacteriseResult
from pincette_supervisor.kinds.characterise.page import HEAD, PAPER_NOTE, facts, rows
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Run, functions_of
from pincette_supervisor.plugin.drawing import Picture
from pincette_supervisor.results.run_samples import RunSamples

DOCS = Path(__file__).parent
RIG = DOCS.parent / "deploy/rigs/demo.toml"
PAGE, IMAGE = DOCS / "reference/demo-data-sheet.md", "data-sheet.png"
NOISE_S = 60.0
TEXT = """# Data sheet of the demo rig

Written by `make demo-sheet` on {date} with pincette {version}: `characterise` on the simulated rig
`deploy/rigs/demo.toml` in virtual time, with {noise_s:g} s for each noise. Its arm never moved
before, and its model is that of the rig file. [How to make such a sheet](../how-to/data-sheet.md)
explains the values.

{facts}

{sections}

{note}

![Loops, responses and force of the demo rig](../images/{image})
"""


def _table(head: tuple[str, ...], lines: list[tuple[str, ...]]) -> str:
    cells = [head, tuple("---" for _ in head), *lines]
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)


def measured(rig: RigFile) -> tuple[Run, CharacteriseResult, Picture]:
    """Return run, result and picture of the job on a rig in lockstep."""
    request = CharacteriseJobRequest(kind="characterise", noise_s=NOISE_S)
    planned, functions = plan_job(request, rig), functions_of(job_kinds()["characterise"])
    messages = ComposedLoop(rig).play(planned.program)
    table = RunSamples.of(messages, rig.rig.period_s, thinned=frozenset()).tables().even
    run = Run(rig, planned, table)
    found = functions.evaluate(run)
    picture, result = functions.plot(run, found, "virtual time"), found.result
    assert isinstance(picture, Picture)
    assert isinstance(result, CharacteriseResult)
    return run, result, picture


def main() -> None:
    """Write the page and its image."""
    file = read_rig(RIG)
    rig = file.model_copy(update={"rig": file.rig.model_copy(update={"time": "lockstep"})})
    run, result, picture = measured(rig)
    sections = [
        f"## {group}\n\n{_table(HEAD, [tuple(line) for line in lines])}"
        for group, lines in rows(result)
    ]
    text = TEXT.format(
        date=datetime.now(UTC).date().isoformat(),
        version=__version__,
        noise_s=NOISE_S,
        facts=_table(("of", "value"), [*facts(run, "virtual time").items()]),
        sections="\n\n".join(sections),
        note=PAPER_NOTE,
        image=IMAGE,
    )
    PAGE.write_text(text, encoding="utf-8")
    (DOCS / "images" / IMAGE).write_bytes(picture.png)


if __name__ == "__main__":
    main()
