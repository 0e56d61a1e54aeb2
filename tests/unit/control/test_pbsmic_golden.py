"""The law beside an independent transcription of (25), (16), (18), (19), (32) over arrays."""

import numpy as np
import numpy.typing as npt
import pytest

from pincette.control.impedance import ImpedanceParameters, discretize_impedance
from pincette.control.pbsmic import PbsmicOutput, PbsmicParameters, start, step
from pincette.control.plant import consistent_arm, discretize, printed_arm

Array = npt.NDArray[np.float64]
TICKS = 200
PAST = 3
"""Samples -3, -2, -1 of every array: the rest before the first tick."""
CONSISTENT = (3.6578e-7, 4.638e-5, 2.1739, 41.304)
PRINTED = (1.8e-3, 126.8, 5.943e6, 1.129e8)
M, B, K, K_F = 1e-3, 8.9221, 1.9901e4, 5000.0


def signals(seed: int) -> dict[str, Array]:
    """Past and TICKS samples: smooth motion, force in between, noise on all of them."""
    draw = np.random.default_rng(seed)
    t = np.arange(-PAST, TICKS) * 0.02
    noise = draw.normal(0.0, 1.0, (5, t.size))
    moving = np.where(t < 0.0, 0.0, 1.0)
    result = {
        "x": 30.0 + moving * (4.0 * np.sin(3.0 * t) + 0.1 * noise[0]),
        "x_r": 30.5 + moving * (4.2 * np.sin(3.0 * t + 0.1)),
        "F": 2.0 + moving * (10.0 * np.sin(3.0 * t) + 0.2 * noise[1]),
        "F_r": 2.0 + moving * (10.0 * np.sin(3.0 * t + 0.1) + 0.1 * noise[2]),
        "u": 1.5 + moving * (0.4 * np.sin(3.0 * t) + 0.01 * noise[3]),
    }
    result["frozen"] = np.where(np.sin(7.0 * t) > 0.9, 1.0, 0.0)
    return result


def transcribe(
    arm: tuple[float, float, float, float],
    T: float,
    gains: tuple[float, float, float, float],
    given: dict[str, Array],
) -> dict[str, Array]:
    m, b, k, d = arm
    mb, bb, kb, db = m / T**2, -2 * m / T**2 - b / T, m / T**2 + b / T + k, d
    Mb, Bb, Kb, Kfb = M / T**2, -2 * M / T**2 - B / T, M / T**2 + B / T + K, K_F
    KP, KI, KS, delta = gains
    x, xr, F, Fr, u = (given[name] for name in ("x", "x_r", "F", "F_r", "u"))
    size = x.size
    xd, e, eps, s, v = (np.zeros(size) for _ in range(5))
    xd[:PAST] = x[:PAST]
    for i in range(PAST, size):
        e[i - 1] = x[i - 1] - xd[i - 1]
        eps[i - 1] = eps[i - 2] + (0.0 if given["frozen"][i] else e[i - 1])
        s[i - 1] = KP * e[i - 1] + KI * eps[i - 1]
        xd[i] = (
            -(Mb / Kb) * (xd[i - 2] - xr[i - 2])
            - (Bb / Kb) * (xd[i - 1] - xr[i - 1])
            - (Kfb / Kb) * (F[i] - Fr[i])
            + xr[i]
        )
        sat = np.sign(s[i - 1]) if abs(s[i - 1]) > delta else s[i - 1] / delta
        Ga = KP + KI
        v[i] = (
            u[i - 1]
            + (kb / Ga * s[i - 1] - kb / Ga * KI * eps[i - 1] + kb * xd[i]) / db
            - (mb * x[i - 3] + (bb - mb) * x[i - 2] + (kb - bb) * x[i - 1] - (F[i] - F[i - 1])) / db
            - KS / db * sat
        )
    p = -db * u + mb * np.roll(x, 2) + bb * np.roll(x, 1) + kb * x + F
    return {"u": v, "x_d": xd, "e": e, "eps": eps, "s": s, "p": p}


def play(parameters: PbsmicParameters, given: dict[str, Array]) -> list[PbsmicOutput]:
    column = {name: [float(value) for value in values] for name, values in given.items()}
    state = start(
        x_um=column["x"][0],
        x_r_um=column["x_r"][0],
        force_mN=column["F"][0],
        applied_V=column["u"][0],
    )
    outputs: list[PbsmicOutput] = []
    for i in range(PAST, PAST + TICKS):
        state, output = step(
            parameters,
            state,
            x_um=column["x"][i - 1],
            force_mN=column["F"][i],
            applied_V=column["u"][i - 1],
            x_r_um=column["x_r"][i],
            force_r_mN=column["F_r"][i],
            freeze_integral=column["frozen"][i] > 0.0,
        )
        outputs.append(output)
    return outputs


def close(values: list[float], wanted: Array) -> None:
    np.testing.assert_allclose(values, wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("period_s", [0.02, 0.001])
@pytest.mark.parametrize(
    "gains", [(5.0, 1.0, 0.003, 100.0), (0.5, 1.0, 0.0, 100.0), (1.0, 2.0, 0.5, 2.0)]
)
@pytest.mark.parametrize("arm_values", [CONSISTENT, PRINTED])
def test_law_equals_its_transcription(
    arm_values: tuple[float, float, float, float],
    gains: tuple[float, float, float, float],
    period_s: float,
) -> None:
    arm = printed_arm() if arm_values == PRINTED else consistent_arm(2437.8, 0.026, 19.0, 0.46)
    given = signals(seed=7)
    parameters = PbsmicParameters(
        discretize(arm, period_s),
        discretize_impedance(ImpedanceParameters(M, B, K, K_F), period_s),
        *gains,
    )
    outputs = play(parameters, given)
    wanted = transcribe((arm.m, arm.b, arm.k, arm.d), period_s, gains, given)

    def now(name: str) -> Array:
        return wanted[name][PAST:]

    def before(name: str) -> Array:
        return wanted[name][PAST - 1 : -1]

    close([o.voltage_V for o in outputs], now("u"))
    close([o.x_d_um for o in outputs], now("x_d"))
    close([o.error_um for o in outputs], before("e"))
    close([o.integral_um for o in outputs], before("eps"))
    close([o.sliding_um for o in outputs], before("s"))
    # (8): p̃_{k-1} = p_{k-2} - p_{k-1}, from the first tick that has both.
    error = (wanted["p"][PAST - 1 : -2] - wanted["p"][PAST:-1])[1:]
    scale = float(np.max(np.abs(error)))
    np.testing.assert_allclose(
        [o.perturbation_error_mN for o in outputs[2:]], error, rtol=1e-7, atol=1e-7 * scale
    )


def test_one_tick_in_numbers() -> None:
    """T = 0.02 s, K_P = 5, K_I = 1, no switching: computed by hand from (5), (13), (16), (25)."""
    parameters = PbsmicParameters(
        discretize(consistent_arm(2437.8, 0.026, 19.0, 0.46), 0.02),
        discretize_impedance(ImpedanceParameters(M, B, K, K_F), 0.02),
        K_P=5.0,
        K_I=1.0,
        K_S=0.0,
        delta=100.0,
    )
    state = start(x_um=30.0, x_r_um=30.0, force_mN=2.0, applied_V=1.6)
    _, output = step(
        parameters,
        state,
        x_um=30.12,
        force_mN=2.5,
        applied_V=1.61,
        x_r_um=30.2,
        force_r_mN=2.1,
        freeze_integral=False,
    )
    assert output.error_um == pytest.approx(0.12)
    assert output.sliding_um == pytest.approx(0.72)
    # 30.2 - 5000·0.4/20349.605
    assert output.x_d_um == pytest.approx(30.2 - 2000.0 / 20349.605, abs=1e-9)
    # u = 1.61 + [k̄(x_d + 0.1) - (m̄ 30 + (b̄ - m̄)30 + (k̄ - b̄)30.12) + 0.5]/41.304348
    # with m̄ = 9.14505e-4, b̄ = -4.147565e-3, k̄ = 2.1771461
    assert output.voltage_V == pytest.approx(1.6264005568, abs=1e-9)
    # 0.12 - (41.304348/2.1771466)·0.01
    assert output.residual_um == pytest.approx(0.12 - 0.1897178, abs=1e-6)
