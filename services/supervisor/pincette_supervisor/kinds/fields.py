"""Form fields and results that several kinds of job share."""

from typing import TypeVar

from pincette.api.job_kinds import FieldSpec, ResultField, choices, number
from pincette.config.laws import installed_laws
from pincette.control.laws import two_arm_law
from pincette.control.laws.parameters import LawParameter

Shown = TypeVar("Shown", FieldSpec, ResultField)


def for_arms(arms: int, *shown: Shown) -> tuple[Shown, ...]:
    """Return fields or results that are shown only for rigs with this number of driven arms."""
    return tuple(one.model_copy(update={"arms": (arms,)}) for one in shown)


ONE_ARM = frozenset(
    {
        "position_tolerance_um",
        "force_tolerance_mN",
        "settling_s",
        "retries",
        "condition",
        "scheme",
        "set",
    }
)
"""Members of requests for jobs with a part; only rigs with one driven arm accept them."""
RECIPE = FieldSpec(name="recipe", label="Recipe", widget="recipe", placeholder="none")
ZERO_CONFIRMED = FieldSpec(
    name="zero_confirmed", label="I have checked that nothing touches the arm", advanced=True
)
CONDITION = FieldSpec(
    name="condition",
    label="Conditioning strokes",
    choices=choices(
        ("", "where the model allows them"),
        ("always", "always"),
        ("never", "never"),
    ),
    advanced=True,
)
_FROM_BUS = {"place-given_by": ("bus",)}
PLACE = (
    FieldSpec(
        name="place-given_by",
        label="Place of the part",
        widget="choice",
        choices=choices(("", "as in the rig file"), ("bus", "newest of a vision client")),
        sent_as="given_by",
        within="place",
        advanced=True,
    ),
    FieldSpec(
        name="place-source",
        label="Vision client",
        widget="text",
        placeholder="the only one",
        sent_as="source",
        within="place",
        when=_FROM_BUS,
        advanced=True,
    ),
    FieldSpec(
        name="place-max_age_s",
        label="Measured within",
        widget="number",
        placeholder="5",
        sent_as="max_age_s",
        within="place",
        own_unit="s",
        when=_FROM_BUS,
        advanced=True,
    ),
)
"""Fields of a job that reads the place of its part from the bus."""
RELEASE = FieldSpec(name="release_s", label="Let go over")
POLICIES = (
    FieldSpec(
        name="on_stop",
        label="A stop",
        choices=choices(
            ("", "keeps the part held"),
            ("release", "releases the part"),
            ("retract", "releases it and retreats"),
        ),
        advanced=True,
    ),
    FieldSpec(
        name="on_abort",
        label="An abort",
        choices=choices(("", "keeps the part for a while"), ("ramp", "releases the part at once")),
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
"""Result fields on the tolerances of a job."""
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
"""Result fields on the causes of the errors of a hold or a path."""
SPEEDS = (
    FieldSpec(name="load_s", label="Load over", advanced=True),
    FieldSpec(name="approach_um_per_s", label="Approach at", advanced=True),
    FieldSpec(name="seek_um_per_s", label="Seek contact at", advanced=True),
)


def _gain(law: str, gain: LawParameter, placeholder: str, **when: tuple[str, ...]) -> FieldSpec:
    """Return the field of a law's gain, shown only with certain values of other fields."""
    return FieldSpec(
        name=f"{law}-{gain.name}",
        label=gain.name,
        widget="number",
        placeholder=placeholder,
        sent_as=gain.name,
        within="gains",
        own_unit=gain.unit,
        meaning=gain.meaning,
        when=when,
        advanced=True,
    )


LAW = (
    *SPEEDS,
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
        _gain(law.name, gain, f"{gain.default:g}", scheme=(law.name,), gains=("",))
        for law in installed_laws().values()
        for gain in law.parameters
    ),
)
CONTACT: tuple[ResultField, ...] = (
    number("contact_load.lowest_mN", "load from", optional=True),
    number("contact_load.highest_mN", "load to", optional=True),
    number(
        "contact_x_um", "contact position, mean over the load", uncertainty="contact_x_error_um"
    ),
    number(
        "contact_stiffness_mN_per_um",
        "contact stiffness, mean over the load",
        digits=3,
        uncertainty="contact_stiffness_error_mN_per_um",
    ),
)
PLACE_FOUND: tuple[ResultField, ...] = (
    number(
        "place.difference_um",
        "place found minus place given",
        uncertainty="place.uncertainty_um",
        optional=True,
    ),
    number("place.bias.mean_um", "mean difference of all jobs with this source", optional=True),
    number("place.bias.deviation_um", "its standard deviation", optional=True),
    number("place.bias.count", "number of jobs with this source", "", digits=0, optional=True),
)
"""Result fields on the place that a request or a vision client has given."""
WIDTH_FOUND: tuple[ResultField, ...] = (
    number(
        "place.width_difference_um",
        "width found minus width given",
        uncertainty="place.width_uncertainty_um",
        optional=True,
    ),
)
"""Result fields on the width that a request or a vision client has given, for two arms."""
ZERO_RETURN: tuple[ResultField, ...] = (
    ResultField(name="zero_return.verified", label="verified by the zero return", optional=True),
    number(
        "zero_return.force_mN",
        "force back at the place of the zero",
        uncertainty="zero_return.uncertainty_mN",
        optional=True,
    ),
)
"""Result fields on the closure error of the force after the part was released."""
POSITION_STEP: tuple[ResultField, ...] = (
    ResultField(name="position_step.cause", label="cause of the step", optional=True),
    number("position_step.step_um", "step of the position", optional=True),
    number("position_step.slip_um", "travel of the part, if it slipped", optional=True),
    number("position_step.force_mN", "force before the step", optional=True),
    number("position_step.force_if_slip_mN", "force after it, if the part slipped", optional=True),
    number(
        "position_step.force_if_sensor_mN", "force after it, if the sensor jumped", optional=True
    ),
    ResultField(name="position_step.rang", label="rang after it, as after a slip", optional=True),
)
"""Result fields on a position step that the voltage does not explain."""
SECOND_ZERO_RETURN = tuple(
    figure.model_copy(
        update={
            "name": f"second_{figure.name}",
            "label": f"arm 2: {figure.label}",
            "uncertainty": figure.uncertainty and f"second_{figure.uncertainty}",
        }
    )
    for figure in ZERO_RETURN
)
"""Result fields on the closure error of the second arm."""
RELEASE_VERDICT: tuple[ResultField, ...] = (
    ResultField(name="release.verdict", label="release", optional=True),
    number(
        "release.pull_off_mN",
        "pull-off force",
        uncertainty="release.pull_off_uncertainty_mN",
        optional=True,
    ),
    number(
        "release.stiffness_mN_per_um",
        "stiffness that still holds the arm",
        uncertainty="release.stiffness_uncertainty_mN_per_um",
        optional=True,
    ),
)
"""Result fields on the release of the part."""
MOTION: tuple[ResultField, ...] = (
    number("ends_at.x_um", "rests at", main=True),
    number("ends_at.voltage_V", "final voltage", digits=3),
    number("target_um", "target", optional=True),
    number("target_error_um", "target error", digits=3, optional=True),
    number("drift_um", "drift while held", digits=3, optional=True),
    *GOAL[:4],
    ResultField(name="teach", label="taught as", optional=True),
    ResultField(name="held_at_end", label="part still held"),
)
PAIR_LAW: tuple[FieldSpec, ...] = (
    *SPEEDS,
    FieldSpec(name="contact_force_mN", label="A touch is", advanced=True),
    *(_gain(two_arm_law.LAW.name, gain, "default") for gain in two_arm_law.LAW.parameters),
)
PAIR_FIGURES: tuple[ResultField, ...] = (
    number("force_held_mN", "force of both arms", uncertainty="force_uncertainty_mN", main=True),
    number("held_place_um", "place", main=True),
    number("met_place_um", "place where the part was touched"),
    number("place_um.rmse", "RMSE of the place", "µm", digits=3),
    number("place_um.rmse_percent", "the same, as a share of its height", optional=True),
    number("force_mN.rmse", "RMSE of the force", "mN", digits=3),
    number("force_mN.rmse_percent", "the same, as a share of its height", optional=True),
    number(
        "difference_mN",
        "difference of both forces",
        digits=3,
        uncertainty="difference_uncertainty_mN",
    ),
    ResultField(name="forces_agree", label="both forces agree"),
    number("peak_force_mN", "peak force of either arm"),
    number(
        "true_place_um.rmse",
        "RMSE of the true place, by the simulation",
        "µm",
        digits=3,
        optional=True,
    ),
    number(
        "true_force_mN.rmse",
        "RMSE of the true force, by the simulation",
        "mN",
        digits=3,
        optional=True,
    ),
    *ZERO_RETURN,
    *SECOND_ZERO_RETURN,
    *RELEASE_VERDICT,
    ResultField(name="held_at_end", label="part still held"),
)
