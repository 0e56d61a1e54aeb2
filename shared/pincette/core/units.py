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
OF_FILES = {
    "_um_per_V2": "µm/V²",
    "_mN_per_decade": "mN/decade",
    "_J_per_m2": "J/m²",
    "_kg_per_m3": "kg/m³",
    "_per_V": "1/V",
    "_periods": "periods",
    "_days": "days",
    "_GPa": "GPa",
    "_MB": "MB",
    "_GB": "GB",
}
"""Units that a rig file has beside those, and no message."""


def unit_of(name: str) -> str:
    """Unit of what a name stands for; empty where it has none."""
    return next((unit for end, unit in UNITS.items() if name.endswith(end)), "")


def bare(name: str) -> str:
    """A name without its unit."""
    return next((name.removesuffix(end) for end in UNITS if name.endswith(end)), name)


def unit_in_file(name: str) -> str:
    """Unit of a key of the rig file; empty where it has none."""
    ends = sorted((UNITS | OF_FILES).items(), key=lambda end: -len(end[0]))
    return next((unit for end, unit in ends if name.endswith(end)), "")
