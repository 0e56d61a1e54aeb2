"""The columns of one arm of two, under the names that a rig of one arm has for them; pure."""

from pincette.records.columns import Columns

COLUMNS = {
    "x_um": "second_x_um",
    "position_valid": "second_position_valid",
    "force_mN": "second_force_mN",
    "force_uncertainty_mN": "second_force_uncertainty_mN",
    "zero_age_s": "second_zero_age_s",
    "stroke_change": "second_stroke_change",
    "stroke_limit": "second_stroke_limit",
    "zero_unconfirmed": "second_zero_unconfirmed",
    "command_V": "second_command_V",
    "voltage_V": "second_voltage_V",
    "limits_active": "second_limits_active",
    "true_x_um": "true_second_x_um",
    "true_force_mN": "true_second_force_mN",
    "true_voltage_V": "true_second_voltage_V",
}
"""Columns of the second arm, by the names of the first."""


def table_of_arm(table: Columns, arm: int) -> Columns:
    """Return the columns as if this arm were the only one."""
    if arm == 1:
        return table
    return {**table, **{name: table[other] for name, other in COLUMNS.items()}}
