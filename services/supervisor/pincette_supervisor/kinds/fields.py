"""Form fields and figures that several kinds of job show."""

from pincette.api.job_kinds import FieldSpec, ResultField, choices, number
from pincette.config.laws import installed_laws

RECIPE = FieldSpec(name="recipe", label="Recipe", widget="recipe", placeholder="none")
ZERO_CONFIRMED = FieldSpec(
    name="zero_confirmed", label="Nothing touches the arm: I have looked", advanced=True
)
CONDITION = FieldSpec(
    name="condition",
    label="Conditioning strokes",
    choices=choices(
        ("", "where the arm's past is not known"),
        ("always", "always"),
        ("never", "never"),
    ),
    advanced=True,
)
RELEASE = FieldSpec(name="release_s", label="Let go over")
POLICIES = (
    FieldSpec(
        name="on_stop",
        label="A stop",
        choices=choices(
            ("", "keeps the part held"),
            ("release", "lets the part go"),
            ("retract", "lets it go and retreats"),
        ),
        advanced=True,
    ),
    FieldSpec(
        name="on_abort",
        label="An abort",
        choices=choices(("", "keeps the part for a while"), ("ramp", "lets go at once")),
        advanced=True,
    ),
)
SETTLING = FieldSpec(name="settling_s", label="Settled within", placeholder="0.5", advanced=True)
TOLERANCES = (
    FieldSpec(name="position_tolerance_um", label="Position within", advanced=True),
    FieldSpec(name="force_tolerance_mN", label="Force within", advanced=True),
    SETTLING,
)
GOAL: tuple[ResultField, ...] = (
    ResultField(name="goal.met", label="goal met", optional=True),
    number("goal.settled_s", "settled after", optional=True),
    number(
        "goal.position_error_um", "largest error of the settled position", digits=3, optional=True
    ),
    number("goal.position_tolerance_um", "its tolerance", digits=3, optional=True),
    number("goal.force_error_mN", "largest error of the settled force", digits=3, optional=True),
    number("goal.force_tolerance_mN", "its tolerance", digits=3, optional=True),
)
"""How near a job came to its references."""
ERROR_SOURCES = tuple(
    figure
    for member, quantity, unit in (
        ("position_um", "position", "µm"),
        ("force_mN", "force", "mN"),
    )
    for figure in (
        number(
            f"error_sources.{member}.total",
            f"{quantity} error, by its causes",
            unit,
            digits=3,
            optional=True,
        ),
        *(
            number(
                f"error_sources.{member}.{cause}",
                f"{quantity} error by {words}",
                unit,
                digits=3,
                optional=True,
            )
            for cause, words in (
                ("noise", "noise"),
                ("response", "the free response"),
                ("contact_line", "the contact line"),
                ("lag", "lag"),
                ("limits", "limits"),
            )
        ),
        ResultField(
            name=f"error_sources.{member}.to_do", label=f"what helps the {quantity}", optional=True
        ),
    )
)
"""Where the errors of a hold or a path come from."""
LAW = (
    FieldSpec(name="load_s", label="Load over", advanced=True),
    FieldSpec(name="approach_um_per_s", label="Approach at", advanced=True),
    FieldSpec(name="seek_um_per_s", label="Seek contact at", advanced=True),
    FieldSpec(
        name="scheme",
        label="Law",
        widget="choice",
        choices=choices(
            ("", "as in the rig file"),
            *((law.name, law.title) for law in installed_laws().values()),
        ),
        advanced=True,
    ),
    FieldSpec(
        name="gains",
        label="Gains",
        widget="choice",
        choices=choices(("", "as in the rig file"), ("tuned", "tuned on the model")),
        advanced=True,
    ),
    *(
        FieldSpec(
            name=f"{law.name}-{gain.name}",
            label=gain.name,
            widget="number",
            placeholder=f"{gain.default:g}",
            sent_as=gain.name,
            within="gains",
            own_unit=gain.unit,
            meaning=gain.meaning,
            when={"scheme": (law.name,), "gains": ("",)},
            advanced=True,
        )
        for law in installed_laws().values()
        for gain in law.parameters
    ),
)
CONTACT: tuple[ResultField, ...] = (
    number("contact_x_um", "contact position", uncertainty="contact_x_error_um"),
    number(
        "contact_stiffness_mN_per_um",
        "contact stiffness",
        digits=3,
        uncertainty="contact_stiffness_error_mN_per_um",
    ),
)
ZERO_RETURN: tuple[ResultField, ...] = (
    ResultField(name="zero_return.verified", label="verified by the zero return", optional=True),
    number(
        "zero_return.force_mN",
        "force back at the place of the zero",
        uncertainty="zero_return.uncertainty_mN",
        optional=True,
    ),
)
"""Closure of the force after the part was let go."""
MOTION: tuple[ResultField, ...] = (
    number("ends_at.x_um", "rests at", main=True),
    number("ends_at.voltage_V", "voltage kept", digits=3),
    number("target_um", "target", optional=True),
    number("target_error_um", "target error", digits=3, optional=True),
    number("drift_um", "drift while held", digits=3, optional=True),
    *GOAL[:4],
    ResultField(name="teach", label="taught as", optional=True),
    ResultField(name="held_at_end", label="part still held"),
)
