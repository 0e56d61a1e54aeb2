"""Where the impedance rests in contact: most of the remaining error is planning error."""


def steady_state_errors(
    *,
    force_r_mN: float,
    x_r_um: float,
    x_e_um: float,
    K_e: float,
    K: float,
    K_f: float,
) -> tuple[float, float]:
    """Steady errors E_x = x - x_r in µm and E_f = F - F_r in mN, on F = K_e·(x - x_e).

        E_x = [F_r + K_e (x_e - x_r)] / (K_e + K/K_f)                                    (51)
        E_f = -(K/K_f) E_x                                                               (52)

    of Q. Xu, IEEE T-ASE 10(3), 2013; K_e and K in mN/µm, K > 0. Written with K_f multiplied
    through, so that K_f = 0 is the position loop. Both vanish for F_r = K_e·(x_r - x_e).
    """
    mismatch_mN = force_r_mN + K_e * (x_e_um - x_r_um)
    scale = mismatch_mN / (K_f * K_e + K)
    return K_f * scale, -K * scale
