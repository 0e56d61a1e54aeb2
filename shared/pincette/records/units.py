"""Units by the ends of names: every name that crosses a border carries its own."""

UNITS = {
    "_mN_per_um": "mN/µm",
    "_um_per_mN": "µm/mN",
    "_um_per_V": "µm/V",
    "_mN_per_s": "mN/s",
    "_um_per_s2": "µm/s²",
    "_um_per_s": "µm/s",
    "_V_per_s": "V/s",
    "_rad_per_s": "rad/s",
    "_percent": "%",
    "_um": "µm",
    "_mN": "mN",
    "_V": "V",
    "_s": "s",
    "_hz": "Hz",
}
"""Longer ends first, so that the first that fits is the unit."""


def unit_of(name: str) -> str:
    """Unit of what a name stands for; empty where it has none."""
    return next((unit for end, unit in UNITS.items() if name.endswith(end)), "")


def bare(name: str) -> str:
    """A name without its unit."""
    return next((name.removesuffix(end) for end in UNITS if name.endswith(end)), name)
