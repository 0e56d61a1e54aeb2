"""Model of the arm for the controller and the estimator."""

import hashlib
from dataclasses import asdict
from math import hypot
from typing import Annotated, Literal

from pydantic import Field, model_validator

from pincette.config.tables import NotNegative, Positive, Table
from pincette.control.arm.plant import ArmParameters, OutputTiming, consistent_arm
from pincette.control.response.conditioned_branch import (
    MOST_STROKES,
    STROKES,
    ConditionedBranch,
)
from pincette.control.response.error_growth import ErrorGrowth, checked_growth
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.recorded_response import RecordedBranches, Turn
from pincette.control.response.residual_table import ResidualTable

USUAL_DELAY = 0.65
"""Delay from a sample until its voltage is applied, in periods, assumed if it has not been
measured.
"""
Row = Annotated[tuple[float, ...], Field(strict=False)]

UNEQUAL = 0.15
"""Assumed difference between the stroke changes of two travels, as a fraction of the change."""
ASSUMED_CREEP_PERCENT = 2.0
"""Assumed creep in % of a step per decade of time if it has not been measured; actuators have 1 to
2."""


class Branch(Table):
    """Rising branch of the conditioned arm; see ``control.response.conditioned_branch``."""

    voltages_V: tuple[float, ...] = Field(strict=False)
    """Voltages of the rising branch, from the bottom of the conditioning strokes on."""
    added_um: tuple[float, ...] = Field(strict=False)
    """Measured position minus that of the model at ``voltages_V``; 0 at the lowest."""
    error_ways_V: tuple[float, ...] = Field(strict=False)
    """Travels of the voltage, since the zero of a conditioned grip, at which the error is known."""
    errors_um: tuple[float, ...] = Field(strict=False)
    """Standard error of the free response at ``error_ways_V``; it contributes to the force
    uncertainty."""
    places_V: tuple[float, ...] = Field(default=(), strict=False)
    """Voltages, ascending, at which measured travels ended that began at the rest after the
    strokes."""
    way_ratios: tuple[Annotated[float, Field(gt=0.8, lt=1.25)], ...] = Field(
        default=(), strict=False
    )
    """Ratio of the measured travel to each of these voltages to the travel computed from model and
    branch.
    """
    way_spread: NotNegative = 0.0
    """Standard deviation of a ratio of ``way_ratios`` between repeated travels."""
    way_uneven: NotNegative = 0.0
    """Additional standard deviation of the ratio at voltages that differ from all measured ones by
    0.05 V or more."""
    strokes: int = Field(default=STROKES, ge=STROKES, le=MOST_STROKES)
    """Number of conditioning strokes before the branch was measured."""
    rest_ratio: float = Field(default=1.0, gt=0.5, lt=2.0)
    """Ratio of the measured travel from the lowest voltage to the rest after the strokes, to the
    travel computed from model and branch.
    """
    rest_spread: NotNegative = 0.0
    """Standard deviation of ``rest_ratio`` between repeated travels."""
    errors_until_s: NotNegative = 0.0
    """Age of the zero up to which ``errors_um`` are valid; creep adds to them after that."""
    rehearsals: int = Field(default=0, ge=0)
    """Number of rehearsed grips from which ``errors_um`` were determined; the force uncertainty is
    widened for a small number. 0: the errors need no widening.
    """

    @model_validator(mode="after")
    def _possible(self) -> "Branch":
        self.branch()
        return self

    @classmethod
    def from_branch(cls, branch: ConditionedBranch) -> "Branch":
        """Return the table of a measured branch."""
        return cls(
            voltages_V=branch.voltages_V,
            added_um=branch.added_um,
            error_ways_V=branch.errors.ways_V,
            errors_um=branch.errors.errors_um,
            places_V=branch.places_V,
            way_ratios=branch.way_ratios,
            way_spread=branch.way_spread,
            way_uneven=branch.way_uneven,
            strokes=branch.strokes,
            rest_ratio=branch.rest_ratio,
            rest_spread=branch.rest_spread,
            errors_until_s=branch.errors.until_s,
            rehearsals=branch.rehearsals,
        )

    def branch(self) -> ConditionedBranch:
        """Return the branch of the table; raises ValueError for impossible values."""
        return ConditionedBranch(
            self.voltages_V,
            self.added_um,
            checked_growth(self.error_ways_V, self.errors_um, self.errors_until_s),
            self.places_V,
            self.way_ratios,
            self.way_spread,
            self.way_uneven,
            self.strokes,
            self.rest_ratio,
            self.rest_spread,
            self.rehearsals,
        )


class IdentifiedFreeResponse(Table):
    """The identified free response, in the form that ``pincette.engine.response_table`` prints."""

    thresholds_V: tuple[float, ...] = Field(strict=False)
    """Threshold r_i of each play operator; the first is 0, the linear term."""
    weights_um_per_V: tuple[float, ...] = Field(strict=False)
    """Weight w_i of each play operator."""
    creep_times_s: tuple[float, ...] = Field(default=(), strict=False)
    """Creep times τ_j, in s."""
    creep_fractions: tuple[float, ...] = Field(default=(), strict=False)
    """Creep fractions κ_j of the static displacement, one for each time."""
    fadings_per_V: tuple[float, ...] = Field(default=(), strict=False)
    """Fading λ_i of each play operator; empty: no fading."""
    return_fadings_per_V: tuple[float, ...] = Field(default=(), strict=False)
    """Fadings μ_i, which replace λ_i while a play operator returns to its centre; empty: equal to
    λ_i.
    """
    curvature_um_per_V2: float = 0.0
    """Curvature q: increase of the stroke with the square of the voltage."""
    squares_um_per_V2: tuple[float, ...] = Field(default=(), strict=False)
    """Coefficient a_i of the square of each play operator; empty: none."""
    cubes_um_per_V3: tuple[float, ...] = Field(default=(), strict=False)
    """Coefficient b_i of the cube of each play operator."""
    bent_V: tuple[float, float] = Field(default=(0.0, 0.0), strict=False)
    """Range of voltages in which squares and cubes are used; beyond it the response continues
    linearly.
    """
    residual_um: NotNegative
    """Residual (r.m.s.) for free motion that was not used in the fit; it contributes to the force
    uncertainty.
    """
    press_gain: float = Field(default=1.0, gt=0.5, lt=2.0)
    """Measured stroke divided by the model's stroke in the range in which parts are pressed; 1 if
    not measured.
    """
    error_ways_V: tuple[float, ...] = Field(default=(), strict=False)
    """Travels of the voltage, since the force was zeroed, at which the error is known; empty: the
    residual is used.
    """
    errors_um: tuple[float, ...] = Field(default=(), strict=False)
    """Standard error of the free response at ``error_ways_V``; it contributes to the force
    uncertainty."""
    return_error_um: NotNegative | None = None
    """Standard error of the free response when the arm returns, after pressing a part, to the
    position of the zero; from rehearsed grips. None: unknown.
    """
    turn_error_um_per_V: NotNegative | None = None
    """Standard error of the slope of the free response over the first 0.2 V after the voltage
    reverses while a part is pressed; from rehearsed grips. None: unknown.
    """
    creep_percent_per_decade: NotNegative = ASSUMED_CREEP_PERCENT
    """Creep after a step, in % of the step per decade of time. After ten times the longest of
    ``creep_times_s``, this creep adds to the force uncertainty. The default is an assumption.
    """
    taught_V: tuple[float, float] | None = Field(default=None, strict=False)
    """Lowest and highest voltage of the motion from which the response was identified; a job that
    presses a part beyond them is refused. None: unknown, and not checked.
    """
    branch: Branch | None = None
    """Rising branch of the arm after conditioning strokes. Without it the response after the
    strokes is computed from the model alone, and a changed stroke of the arm is not detected.
    """

    @model_validator(mode="after")
    def _possible(self) -> "IdentifiedFreeResponse":
        self.hysteresis()
        self.growth()
        if self.taught_V is not None and not self.taught_V[0] < self.taught_V[1]:
            least_V, largest_V = self.taught_V
            raise ValueError(f"taught_V = [{least_V}, {largest_V}]: must be ascending")
        return self

    @classmethod
    def from_model(
        cls,
        model: HysteresisModel,
        residual_um: float,
        press_gain: float = 1.0,
        growth: ErrorGrowth | None = None,
        taught_V: tuple[float, float] | None = None,
        creep_percent_per_decade: float = ASSUMED_CREEP_PERCENT,
        return_error_um: float | None = None,
        turn_error_um_per_V: float | None = None,
        branch: ConditionedBranch | None = None,
    ) -> "IdentifiedFreeResponse":
        """Return the table of an identified model."""
        nothing = ErrorGrowth((), ())
        return cls(
            **asdict(model),
            residual_um=residual_um,
            press_gain=press_gain,
            error_ways_V=(growth or nothing).ways_V,
            errors_um=(growth or nothing).errors_um,
            taught_V=taught_V,
            return_error_um=return_error_um,
            turn_error_um_per_V=turn_error_um_per_V,
            creep_percent_per_decade=creep_percent_per_decade,
            branch=None if branch is None else Branch.from_branch(branch),
        )

    def stroked(self, factor: float, piezo_um_per_V: float) -> "IdentifiedFreeResponse":
        """Return the same response with a stroke that is larger by a factor.

        The stroke of an actuator is not proportional to the voltage, so a factor measured over one
        travel differs from those over other travels. The errors are therefore increased by
        ``UNEQUAL`` times the change.
        """
        unequal_um_per_V = UNEQUAL * abs(factor - 1.0) * piezo_um_per_V

        def times(values: tuple[float, ...]) -> tuple[float, ...]:
            return tuple(factor * value for value in values)

        def wider(ways_V: tuple[float, ...], errors_um: tuple[float, ...]) -> tuple[float, ...]:
            return tuple(
                hypot(error_um, unequal_um_per_V * way_V)
                for way_V, error_um in zip(ways_V, errors_um, strict=True)
            )

        changed: dict[str, object] = {
            "weights_um_per_V": times(self.weights_um_per_V),
            "curvature_um_per_V2": factor * self.curvature_um_per_V2,
            "squares_um_per_V2": times(self.squares_um_per_V2),
            "cubes_um_per_V3": times(self.cubes_um_per_V3),
            "errors_um": wider(self.error_ways_V, self.errors_um),
        }
        branch = self.branch
        if branch is not None:
            changed["branch"] = branch.model_copy(
                update={
                    "added_um": times(branch.added_um),
                    "errors_um": wider(branch.error_ways_V, branch.errors_um),
                }
            )
        return self.model_copy(update=changed)

    def growth(self) -> ErrorGrowth | None:
        """Return the error as a function of the travel since the force was zeroed, or None if it is
        unknown.

        Raises ValueError for impossible values.
        """
        if not self.error_ways_V and not self.errors_um:
            return None
        return checked_growth(self.error_ways_V, self.errors_um)

    def hysteresis(self) -> HysteresisModel:
        """Return the model of the table; raises ValueError for impossible values."""
        return HysteresisModel(
            thresholds_V=self.thresholds_V,
            weights_um_per_V=self.weights_um_per_V,
            creep_times_s=self.creep_times_s,
            creep_fractions=self.creep_fractions,
            fadings_per_V=self.fadings_per_V,
            curvature_um_per_V2=self.curvature_um_per_V2,
            squares_um_per_V2=self.squares_um_per_V2,
            cubes_um_per_V3=self.cubes_um_per_V3,
            bent_V=self.bent_V,
            return_fadings_per_V=self.return_fadings_per_V,
        )


class RecordedFreeResponse(Table):
    """The free response as recorded branches; see ``control.recorded_response``."""

    bottom_V: float
    """Voltage at which the ascending branch begins."""
    bottom_um: float
    """Position at ``bottom_V``."""
    top_V: float
    """Voltage at which the descending branch begins."""
    top_um: float
    """Position at ``top_V``."""
    ascending: tuple[float, ...] = Field(strict=False)
    """Relative heights between bottom (0) and top (1), at equal steps of the voltage."""
    descending: tuple[float, ...] = Field(strict=False)
    """Relative heights along the descending branch, at equal steps of the voltage."""
    residual_um: NotNegative
    """Residual (r.m.s.) for free motion that was not recorded; it contributes to the force
    uncertainty.
    """

    @model_validator(mode="after")
    def _possible(self) -> "RecordedFreeResponse":
        self.branches()
        return self

    @classmethod
    def from_branches(
        cls, branches: RecordedBranches, residual_um: float
    ) -> "RecordedFreeResponse":
        """Return the table of recorded branches."""
        return cls(
            bottom_V=branches.bottom.voltage_V,
            bottom_um=branches.bottom.x_um,
            top_V=branches.top.voltage_V,
            top_um=branches.top.x_um,
            ascending=branches.ascending,
            descending=branches.descending,
            residual_um=residual_um,
        )

    def branches(self) -> RecordedBranches:
        """Return the branches of the table; raises ValueError for impossible values."""
        return RecordedBranches(
            bottom=Turn(self.bottom_V, self.bottom_um),
            top=Turn(self.top_V, self.top_um),
            ascending=self.ascending,
            descending=self.descending,
        )


class FreeResidual(Table):
    """Residual of the free response along one program; see ``control.residual_table``."""

    program: str
    """Digest of the program's motion."""
    response: str
    """Digest of the free response."""
    job: str
    """Job that played the voltages of the program."""
    measured_at: str = ""
    """Time of the measurement in UTC; set when the table comes into use."""
    stride_ticks: int = Field(ge=1)
    """Number of ticks between two values."""
    values_um: tuple[Row, ...] = Field(strict=False)
    """Values by segment of the program."""
    error_um: NotNegative
    """Standard error when the motion is repeated; it contributes to the force uncertainty."""

    @model_validator(mode="after")
    def _possible(self) -> "FreeResidual":
        self.table()
        return self

    def table(self) -> ResidualTable:
        """Return the table in the form for the estimator; raises ValueError for impossible
        values.
        """
        return ResidualTable(self.stride_ticks, self.values_um, self.error_um)


class Model(Table):
    """Model of the arm for the controller and the estimator."""

    natural_frequency_rad_per_s: Positive = 2437.8
    """Undamped natural frequency of the free arm's first mode."""
    damping_ratio: Positive = 0.0260
    """Damping ratio of the free arm's first mode."""
    piezo_um_per_V: Positive = 19.0
    """d_p: free stroke per volt at the amplifier's input, without hysteresis."""
    compliance_um_per_mN: Positive = 0.46
    """s_p: deflection per force at the tip."""
    hysteresis_fraction: NotNegative = 0.2
    """Standard error of the linear free response, as a fraction of the largest travel of the
    voltage since the zero; the default is for an arm that was not calibrated.
    """
    creep_mN_per_decade: NotNegative = 0.3
    """Increase of the force uncertainty per decade of the zero's age."""
    forgotten_mN: NotNegative = 3.0
    """Largest standard error of the force due to small reversals of the voltage, which reduce the
    hysteresis.
    """
    forgotten_scale_V: Positive = 0.4
    """Travel of small reversals since the zero, in one direction, at which 63 % of ``forgotten_mN``
    is reached."""
    force_filter_s: NotNegative = 0.03
    """Time constant of the law's low-pass over the force error."""
    output_delay_s: NotNegative | None = None
    """Time from a sample until the voltage that responds to it is applied, used by laws that look
    ahead and by the observer "smooth".
    """
    output_lag_s: NotNegative = 0.0
    """Time constant of a first-order lag between output and arm, such as an RC before the
    amplifier."""
    force_observer: Literal["quasi_static", "inverse_dynamics", "kalman", "smooth"] = "quasi_static"
    """Method that computes the force from position and free response. "quasi_static" is suitable
    for long periods only; "smooth" is suitable for short periods if the law does not excite the
    mode, as "fpbsmic".
    """
    force_ages: Literal["matched", "printed"] = "matched"
    """Ages of x and x_1 in (53): matched, or as printed in the paper; see ``control.observers``."""
    force_rate_mN_per_s: Positive = 50.0
    """Rate of change of the force that ``kalman`` assumes, as r.m.s. over a period."""
    inverse_filter_s: NotNegative = 0.0005
    """Time constant τ of the filter 1/(τs + 1)² in ``inverse_dynamics``."""
    free_response: IdentifiedFreeResponse | None = None
    """Identified free response."""
    recorded_response: RecordedFreeResponse | None = None
    """Recorded free response, used in place of the identified one. Without either, the free
    response is a straight line."""

    residuals: tuple[FreeResidual, ...] = Field(default=(), strict=False)
    """Residuals of the free response for certain programs, each measured by a run without the
    part.
    """

    @model_validator(mode="after")
    def _printed_ages_are_quasi_static(self) -> "Model":
        if self.force_ages == "printed" and self.force_observer != "quasi_static":
            raise ValueError(
                f'force_ages = "printed" with force_observer = "{self.force_observer}": only '
                '"quasi_static" has the printed ages'
            )
        return self

    @model_validator(mode="after")
    def _one_free_response(self) -> "Model":
        if self.free_response is not None and self.recorded_response is not None:
            raise ValueError(
                "[model.free_response] and [model.recorded_response] are both given: omit "
                "the one that x_1 does not use"
            )
        return self

    def response_digest(self) -> str:
        """Return the digest of the free response.

        A table of residuals is valid for one response only.
        """
        known = {"piezo_um_per_V", "free_response", "recorded_response"}
        return hashlib.sha256(self.model_dump_json(include=known).encode()).hexdigest()[:16]

    def output(self, period_s: float) -> OutputTiming:
        """Return the delays between a sample and the effect of its voltage on the arm, measured or
        assumed.
        """
        given_s = self.output_delay_s
        delay_s = USUAL_DELAY * period_s if given_s is None else given_s
        return OutputTiming(delay_s, self.output_lag_s)

    def arm(self) -> ArmParameters:
        """Return m, b, k, d of the parameter set "consistent"."""
        return consistent_arm(
            self.natural_frequency_rad_per_s,
            self.damping_ratio,
            self.piezo_um_per_V,
            self.compliance_um_per_mN,
        )
