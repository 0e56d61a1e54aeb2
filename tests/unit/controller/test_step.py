"""The controller's step: loading laws, changing them during a program, and telemetry."""

import dataclasses
from pathlib import Path

import pytest
from msgspec.structs import replace

from pincette.config import read_rig
from pincette.config.derived import free_response
from pincette.control.laws import law as control_law
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.law import Law, LawState, build
from pincette.control.laws.law import start as start_law
from pincette.control.laws.parameters import LawSpec
from pincette.control.laws.pbsmic import PbsmicState
from pincette.control.safety.voltage import SLEW_DOWN, VOLTAGE_MAX
from pincette.core.messages import Arm, Command, Load
from pincette.core.service import RefusedError
from pincette_controller.config import configure
from pincette_controller.control_laws import OneArmLaw
from pincette_controller.step import Inputs, handle, start, step
from tests.support.arms import with_arm
from tests.support.laws import default_settings

from .bench import ARM, CONFIG, DSMIFC, PBSMIC, QUIET, Bench, T, Tick, program

BOTH_LAWS = (PBSMIC, DSMIFC)
DEMO = read_rig(Path(__file__).parents[3] / "deploy/rigs/demo.toml")


def test_a_program_without_a_law_uses_the_law_of_the_rig_file() -> None:
    bench = Bench(program())
    assert bench.state.laws == (OneArmLaw(build(CONFIG.law, ARM, T, 0.03)),)


def test_the_laws_of_a_program_are_built_when_it_is_loaded() -> None:
    bench = Bench(program(BOTH_LAWS, load=1))
    assert bench.state.laws == tuple(OneArmLaw(build(law, ARM, T, 0.03)) for law in BOTH_LAWS)


def test_the_rig_file_determines_arm_law_and_low_pass() -> None:
    config = configure(DEMO)
    assert config.period_s == 0.02
    assert config.force_filter_s == DEMO.model.force_filter_s
    assert config.law == default_settings("pbsmic", "identified")
    assert config.law.gains["K_f"] == 2000.0
    assert config.arms[0].response == free_response(DEMO.model)
    assert config.arms[0].parameters.d / config.arms[0].parameters.k == pytest.approx(19.0)


@pytest.mark.parametrize("law", [2, -1])
def test_a_segment_must_name_an_existing_law(law: int) -> None:
    with pytest.raises(RefusedError, match=f"hold names law {law}, there are 2"):
        handle(CONFIG, start(CONFIG), Load(program(BOTH_LAWS, hold=law)), 0.0)
    with pytest.raises(RefusedError, match="hold names law 1, there are 1"):
        handle(CONFIG, start(CONFIG), Load(program(hold=1)), 0.0)


def test_an_impossible_law_is_refused_before_anything_moves() -> None:
    state, _, _ = handle(CONFIG, start(CONFIG), Load(program()), 0.0)
    impossible = program((PBSMIC, DSMIFC.with_gains(M=1e308)), load=1)
    with pytest.raises(RefusedError, match=r"a law of the program: impedance K̄ = inf mN/µm"):
        handle(CONFIG, state, Load(impossible), 0.0)
    armed, _, _ = handle(CONFIG, state, Arm(1, 5, ""), 0.0)
    assert armed.program == program()


def test_a_program_without_segments_and_an_arming_without_program_are_refused() -> None:
    with pytest.raises(RefusedError, match="no segments"):
        handle(CONFIG, start(CONFIG), Load(replace(program(), segments=())), 0.0)
    with pytest.raises(RefusedError, match="load one first"):
        handle(CONFIG, start(CONFIG), Arm(1, 5, ""), 0.0)


def test_loading_a_program_does_not_affect_the_running_one() -> None:
    bench = Bench(program())
    bench.until("approach")
    bench.state, _, _ = handle(CONFIG, bench.state, Load(program(BOTH_LAWS, load=1)), 0.0)
    assert len(bench.state.laws) == 1
    bench.until()
    armed, _, _ = handle(CONFIG, bench.state, Arm(2, 5, ""), 0.0)
    assert len(armed.laws) == 2


def test_both_laws_complete_a_grip() -> None:
    bench = Bench(program(BOTH_LAWS, load=1, hold=0, unload=1))
    last = bench.until()
    assert last.telemetry.outcome == "gripped"
    assert bench.x_um == pytest.approx(0.0, abs=0.01)
    held = [tick for tick in bench.ticks if tick.telemetry.phase == "hold"][-1]
    assert held.estimate.arms[0].force_mN == pytest.approx(20.0, abs=0.05)
    assert last.command.final
    (command,) = step(CONFIG, bench.state, Inputs(bench.estimate()), 0.0)[1]
    assert isinstance(command, Command)
    assert not command.valid


def first_of(ticks: list[Tick], phase: str) -> int:
    return next(i for i, tick in enumerate(ticks) if tick.telemetry.phase == phase)


def voltage_step(ticks: list[Tick], index: int) -> float:
    """Return the change of voltage that the tick requests."""
    return ticks[index].command.arms[0].voltage_V - ticks[index].estimate.arms[0].applied_V


def test_a_change_of_law_between_segments_is_bumpless() -> None:
    """Compared with the same grip with one law: each change costs less than the plan's largest
    step."""
    one, two = Bench(program(BOTH_LAWS)), Bench(program(BOTH_LAWS, load=1, hold=0, unload=1))
    one.until()
    two.until()
    for phase in ("load", "hold", "unload"):
        ours = voltage_step(two.ticks, first_of(two.ticks, phase))
        plans = voltage_step(one.ticks, first_of(one.ticks, phase))
        moves = [
            abs(voltage_step(one.ticks, i))
            for i, tick in enumerate(one.ticks)
            if tick.telemetry.phase == "load"
        ]
        assert abs(ours - plans) < max(moves)
        assert max(moves) < 0.1


@pytest.mark.parametrize("load", [0, 1], ids=["same law", "another law"])
@pytest.mark.parametrize("laws", [BOTH_LAWS, BOTH_LAWS[::-1]], ids=["to dsmifc", "to pbsmic"])
def test_the_force_starts_and_ends_without_a_bump(laws: tuple[LawSettings, ...], load: int) -> None:
    """2 mN that are fed suddenly would be a step of 2/41.3 V, and an x_r ahead of the pressed
    arm as much again."""
    bench = Bench(program(laws, load=load, hold=load, unload=load))
    bench.until()
    for phase in ("load", "retreat"):
        index = first_of(bench.ticks, phase)
        assert abs(voltage_step(bench.ticks, index)) < 0.001, phase
    assert bench.ticks[first_of(bench.ticks, "load")].estimate.arms[0].force_mN > 2.0


def test_restarting_a_law_in_contact_would_cause_a_bump(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counterexample: a step of 20 mN at the start of the hold is 20/41.3 V."""

    def restart(
        law: Law,
        state: LawState,
        *,
        x_um: float,
        x_r_um: float,
        force_mN: float,
        force_r_mN: float,
        seen_V: float | None,
    ) -> LawState:
        assert seen_V is None
        assert force_mN == pytest.approx(force_r_mN, abs=1.0)
        applied_V = state.law.history.applied_V
        return start_law(law, x_um=x_um, x_r_um=x_r_um, force_mN=0.0, applied_V=applied_V)

    bench = Bench(program(BOTH_LAWS, hold=1))
    bench.until("load")
    monkeypatch.setattr(control_law, "rebase", restart)
    bench.until("hold")
    assert abs(voltage_step(bench.ticks, -1)) > 0.3


@pytest.mark.parametrize("other", [DSMIFC, PBSMIC.with_gains(K_P=0.5)], ids=["dsmifc", "gains"])
def test_a_change_of_law_during_motion_is_invisible(other: LawSettings) -> None:
    """The seek has its full speed from its first sample, at which its law begins."""
    steps: list[list[float]] = []
    for plays in (program((PBSMIC, other), contact=1), program((PBSMIC,))):
        bench = Bench(plays)
        bench.until("contact")
        for _ in range(5):
            bench.tick()
        found = [voltage_step(bench.ticks, index) for index in range(-6, 0)]
        assert all(step_V == pytest.approx(4.0 * T / 19.0, rel=0.02) for step_V in found)
        steps.append(found)
    assert steps[0] == pytest.approx(steps[1], abs=1e-6)


def test_telemetry_contains_the_references_set_for_its_sample() -> None:
    bench = Bench(program(BOTH_LAWS, load=1))
    bench.until("load")
    telemetry = bench.tick().telemetry
    for _ in range(12):
        set_for = bench.state.player
        assert set_for is not None
        telemetry = bench.tick().telemetry
        assert telemetry.arms[0].x_r_um == set_for.ref.x_um
        assert telemetry.force_r_mN == set_for.ref.force_mN
    after = bench.state.player
    assert after is not None
    # They have advanced meanwhile, for the next sample.
    assert after.ref.x_um > telemetry.arms[0].x_r_um + 0.1
    # The plan fits the part, so the sample is at its reference.
    assert bench.ticks[-1].estimate.arms[0].x_um == pytest.approx(telemetry.arms[0].x_r_um, abs=0.1)
    assert telemetry.arms[0].x_d_um == pytest.approx(telemetry.arms[0].x_r_um, abs=0.1)


@pytest.mark.parametrize("settings", BOTH_LAWS, ids=["pbsmic", "dsmifc"])
def test_telemetry_has_the_band_and_the_perturbation_of_the_sample(settings: LawSettings) -> None:
    """p steps by 1.5 mN at rest: p̃ = -1.5 mN, and the band is a(K_S + 1.5)/2 once."""
    law = settings.with_gains(K_S=0.4, delta=1e6)
    bench = Bench(program((law,)))
    bench.tick()
    bench.tick()
    bench.x_um += 1.5 / bench.plant.k_bar
    telemetry = bench.tick().telemetry
    a = 3.0 / bench.plant.k_bar
    assert telemetry.perturbation_mN == pytest.approx(1.5, abs=1e-9)
    assert telemetry.perturbation_error_mN == pytest.approx(-1.5, abs=1e-9)
    assert telemetry.residual_um == pytest.approx(1.5 / bench.plant.k_bar, abs=1e-9)
    assert telemetry.band_um == pytest.approx(0.5 * a * (0.4 + 1.5), abs=1e-9)
    assert telemetry.sliding_um == pytest.approx(3.0 * 1.5 / bench.plant.k_bar, rel=0.05)


@pytest.mark.parametrize(
    ("limits", "frozen"), [(VOLTAGE_MAX, True), (SLEW_DOWN, False), (0, False)]
)
def test_an_active_limit_stops_the_integral_only_in_its_own_direction(
    limits: int, frozen: bool
) -> None:
    """The arm is below its reference: the law requests more."""
    bench = Bench(program())
    bench.until("approach")
    for _ in range(10):
        bench.tick()
    bench.x_um -= 1.0
    before = bench.state.law_state
    estimate = with_arm(bench.estimate(), limits_active=limits)
    after = step(CONFIG, bench.state, Inputs(estimate), 0.0)[0].law_state
    assert isinstance(before, LawState)
    assert isinstance(after, LawState)
    assert isinstance(before.law, PbsmicState)
    assert isinstance(after.law, PbsmicState)
    assert (after.law.integral_um == before.law.integral_um) is frozen


def test_without_valid_samples_or_an_arming_no_voltage_is_requested() -> None:
    bench = Bench(program())
    bench.tick()
    before = bench.state.player
    state, outputs = step(
        CONFIG, bench.state, Inputs(with_arm(bench.estimate(), valid=False, applied_V=0.7)), 0.0
    )
    (command,) = outputs
    assert isinstance(command, Command)
    assert (command.valid, command.arms[0].voltage_V) == (False, 0.7)
    assert state.player == before
    stray = replace(QUIET, epoch=9)
    assert step(CONFIG, state, Inputs(stray), 0.0)[1] == ()
    assert step(CONFIG, state, Inputs(None), 0.0) == (state, ())


def test_the_hysteresis_memory_follows_the_applied_voltage_and_outlives_an_arming() -> None:
    """A missing voltage is left out and counted for two periods later, as in the estimator."""
    config = configure(DEMO)
    state, _, _ = handle(config, start(config), Load(program()), 0.0)
    state, _, _ = handle(config, state, Arm(1, 5, ""), 0.0)
    wanted = config.arms[0].response
    for seq, (voltage_V, degraded) in enumerate(
        [(0.0, False), (0.5, False), (9.0, True), (0.8, False)]
    ):
        estimate = with_arm(QUIET, seq=seq, applied_V=voltage_V, degraded=degraded, valid=False)
        state, _ = step(config, state, Inputs(estimate), 0.0)
        if not degraded:
            wanted = wanted.updated(voltage_V, 2 * T if seq == 3 else T)
    assert state.memories[0].response == wanted
    again, _, _ = handle(config, state, Arm(2, 5, ""), 0.0)
    assert again.memories[0].response == wanted
    assert again.memories[0].followed_seq == -1


def test_a_new_model_is_initialized_with_the_past_voltages() -> None:
    config = configure(DEMO)
    state, _, _ = handle(config, start(config), Load(program()), 0.0)
    state, _, _ = handle(config, state, Arm(1, 5, ""), 0.0)
    for seq, voltage_V in enumerate([0.5, 1.5, 1.0, 1.0]):
        estimate = with_arm(QUIET, seq=seq, applied_V=voltage_V, valid=False)
        state, _ = step(config, state, Inputs(estimate), 0.0)
    assert DEMO.model.free_response is not None
    taught = DEMO.model.free_response.model_copy(update={"curvature_um_per_V2": 0.5})
    other = DEMO.model_copy(
        update={"model": DEMO.model.model_copy(update={"free_response": taught})}
    )
    again, _, _ = handle(configure(other), state, Arm(2, 5, ""), 0.0)
    assert again.memories[0].response == state.memories[0].past.replayed(
        configure(other).arms[0].response
    )
    assert again.memories[0].response.voltage_V == pytest.approx(1.0)
    assert again.memories[0].response.position_um() != state.memories[0].response.position_um()


def test_a_law_that_needs_a_model_is_built_when_an_arming_supplies_the_model() -> None:
    line = free_response(DEMO.model.model_copy(update={"free_response": None}))
    before = configure(DEMO)
    arm = dataclasses.replace(before.arms[0], response=line)
    before = dataclasses.replace(before, arms=(arm,))
    named = (LawSpec("pbsmic", set="identified"),)
    loaded = Load(replace(program(), laws=named))
    state, _, _ = handle(before, start(before), loaded, 0.0)
    with pytest.raises(RefusedError, match="no free response is identified"):
        handle(before, state, Arm(1, 5, ""), 0.0)
    armed, _, _ = handle(configure(DEMO), state, Arm(1, 5, ""), 0.0)
    assert armed.playing
