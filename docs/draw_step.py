"""Draw one step of a law as blocks, for docs/draw_method.py."""

from itertools import pairwise
from typing import Any

from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from pincette.plotting import BLUE, FAINT, GREEN, INK, ORANGE, Axis, picture


def step_picture() -> bytes:
    """Draw one step of a law as blocks."""
    return picture(1, 1, 4.4, _step_blocks)


def _step_blocks(axes: list[Axis]) -> None:
    axis = axes[0]
    axis.set_axis_off()
    axis.set_xlim(0.0, 100.0)
    axis.set_ylim(0.0, 46.0)

    def box(x: float, y: float, width: float, text: str, colour: str, dashed: bool = False) -> None:
        shape = FancyBboxPatch(
            (x, y),
            width,
            8.0,
            boxstyle="round,pad=0.3",
            facecolor="white",
            edgecolor=colour,
            linewidth=1.6,
            linestyle="--" if dashed else "-",
        )
        axis.add_patch(shape)
        axis.text(x + 0.5 * width, y + 4.0, text, ha="center", va="center", fontsize=9, color=INK)

    def arrow(*points: tuple[float, float], dashed: bool = False) -> None:
        style: dict[str, Any] = {
            "color": FAINT if dashed else INK,
            "linewidth": 1.2,
            "linestyle": "--" if dashed else "-",
        }
        for start, end in pairwise(points[:-1]):
            axis.plot([start[0], end[0]], [start[1], end[1]], **style)
        axis.add_patch(
            FancyArrowPatch(points[-2], points[-1], arrowstyle="-|>", mutation_scale=11, **style)
        )

    def note(x: float, y: float, text: str, align: str = "center") -> None:
        axis.text(x, y, text, ha=align, va="center", fontsize=9, color=INK)

    for y, text in (
        (39.0, "plan: $x_{r,k},\\ F_{r,k}$"),
        (34.8, "estimate: $F_k$"),
        (24.0, "newest sample: $x_{k-1}$"),
        (11.0, "past: $x_{k-2},\\ x_{k-3},\\ F_{k-1}$"),
        (8.0, "applied: $u_{k-1}$"),
    ):
        note(18.0, y, text, "right")
        arrow((18.6, y), (23.6, y))
    box(24.0, 33.0, 25.0, "impedance filter (14)\nwhere the arm should be", BLUE)
    error = "of the error $e_{k-1}=x_{k-1}-x_{d,k-1}$"
    box(24.0, 20.0, 25.0, f"{error}\nkeep $K_P/(K_P+K_I)$", GREEN)
    box(24.0, 7.0, 25.0, "one-step prediction (17)\nwhere it goes if $u$ stays", ORANGE)
    box(64.0, 20.0, 13.0, "µm into V\n$\\bar k/\\bar d\\approx 1/d_p$", INK)
    box(
        64.0, 33.0, 13.0, "switching\n$-\\frac{K_S}{\\bar d}\\,$sat$(s_{k-1}/\\delta)$", FAINT, True
    )
    arrow((20.0, 24.0), (20.0, 14.0), (23.6, 14.0))
    arrow((20.0, 34.8), (20.0, 31.0), (22.0, 31.0), (22.0, 16.0), (26.0, 16.0), (26.0, 15.4))
    axis.add_patch(_circle(57.0, 24.0))
    note(57.0, 24.0, "Σ")
    arrow((49.4, 37.0), (57.0, 37.0), (57.0, 26.2))
    note(53.0, 38.6, "$x_{d,k}$")
    arrow((49.4, 24.0), (54.8, 24.0))
    arrow((49.4, 11.0), (57.0, 11.0), (57.0, 21.8))
    note(53.0, 12.6, "$\\hat x_k$")
    note(58.8, 28.0, "+")
    note(53.4, 25.4, "+")
    note(58.8, 20.0, "−")
    arrow((59.2, 24.0), (63.6, 24.0))
    arrow((77.4, 24.0), (84.8, 24.0))
    note(81.0, 25.8, "$u_k-u_{k-1}$")
    axis.add_patch(_circle(87.0, 24.0))
    note(87.0, 24.0, "Σ")
    arrow((77.4, 37.0), (87.0, 37.0), (87.0, 26.2), dashed=True)
    arrow((20.0, 8.0), (20.0, 2.5), (87.0, 2.5), (87.0, 21.8))
    note(90.0, 14.0, "$u_{k-1}$")
    arrow((89.2, 24.0), (96.0, 24.0))
    note(98.0, 24.0, "$u_k$")


def _circle(x: float, y: float) -> FancyBboxPatch:
    return FancyBboxPatch(
        (x - 1.4, y - 1.4),
        2.8,
        2.8,
        boxstyle="circle,pad=0.35",
        facecolor="white",
        edgecolor=INK,
        linewidth=1.2,
    )
