"""Search for gains, drawn as a figure, and a test of the result on the rig."""

from pincette.config.gains import tuned
from pincette.control.stability.tuning import Tuning
from pincette.plotting import BLUE, FAINT, ORANGE, RED, Axis, label, legend, picture
from pincette_study.calibrated import Prepared
from pincette_study.closed_loop import Errors, track, tracking_plan
from pincette_study.report import Comparison, Picture, Section

SCHEMES = ("pbsmic", "dsmifc")


def search(prepared: Prepared) -> Section:
    """Tune both laws on the identified model, then track with the chosen gains."""
    found: dict[str, Tuning] = {
        scheme: tuned(prepared.rig, scheme, "consistent") for scheme in SCHEMES
    }
    plan = tracking_plan(prepared.rig)
    tried: dict[str, Errors] = {
        scheme: track(prepared.rig, tuning.chosen.settings, plan)[1]
        for scheme, tuning in found.items()
    }
    rows: list[Comparison] = []
    for scheme, tuning in found.items():
        chosen, errors = tuning.chosen, tried[scheme]
        gains = f"K_P = {chosen.settings.gains['K_P']:g}, K_f = {chosen.settings.gains['K_f']:g}"
        name = scheme.upper()
        rows += [
            Comparison(f"{name} position, predicted", "%", None, chosen.position_percent, gains),
            Comparison(f"{name} position, tracked", "%", None, errors.position_percent),
            Comparison(f"{name} force, predicted", "%", None, chosen.force_percent, gains),
            Comparison(f"{name} force, tracked", "%", None, errors.force_percent),
            Comparison(f"{name} worst spectral radius", "", None, tuning.radius),
        ]
    return Section(
        key="gains",
        title="Gains by search instead of by trial and error",
        text=(
            "Each point is a law with its own K_P and K_f on the identified model: sensor noise, "
            "a contact stiffness that errs by 1 % and a force that errs by what the free response "
            "leaves open. Gains whose loop comes too near to instability do not count. The front "
            "is what no other beats in both errors; the balanced point has the smallest larger "
            "error.",
        ),
        pictures=(Picture("gains", "position against force error", _picture(found, tried)),),
        comparisons=tuple(rows),
    )


def _picture(found: dict[str, Tuning], tried: dict[str, Errors]) -> bytes:
    def draw(axes: list[Axis]) -> None:
        for axis, (scheme, tuning) in zip(axes, found.items(), strict=True):
            axis.plot(
                [item.position_percent for item in tuning.candidates],
                [item.force_percent for item in tuning.candidates],
                "o",
                color=FAINT,
                markersize=3,
                label="stable gains",
            )
            axis.plot(
                [item.position_percent for item in tuning.front],
                [item.force_percent for item in tuning.front],
                "o-",
                color=BLUE,
                label="Pareto front",
            )
            chosen, errors = tuning.chosen, tried[scheme]
            gains = chosen.settings.gains
            axis.plot(
                chosen.position_percent,
                chosen.force_percent,
                "D",
                color=ORANGE,
                label=f"balanced: $K_P$ = {gains['K_P']:g}, $K_f$ = {gains['K_f']:g}",
            )
            axis.plot(
                errors.position_percent, errors.force_percent, "x", color=RED, label="tracked"
            )
            label(axis, "position RMSE / %", "force RMSE / %", scheme.upper())
            legend(axis)

    return picture(1, 2, 4.2, draw)
