"""Units as suffixes of names: every name that crosses an interface ends with its unit."""

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
"""Units by suffix of a name, longer suffixes first, so that the first match is the unit."""
OF_FILES = {
    "_um_per_V2": "µm/V²",
    "_mN_per_decade": "mN/decade",
    "_J_per_m2": "J/m²",
    "_kg_per_m3": "kg/m³",
    "_um3": "µm³",
    "_per_V": "1/V",
    "_periods": "periods",
    "_days": "days",
    "_GPa": "GPa",
    "_MB": "MB",
    "_GB": "GB",
}
"""Units that occur only in rig files, not in messages."""


def unit_of(name: str) -> str:
    """Return the unit of a name, or an empty text."""
    return next((unit for end, unit in UNITS.items() if name.endswith(end)), "")


def bare(name: str) -> str:
    """Return a name without its unit suffix."""
    return next((name.removesuffix(end) for end in UNITS if name.endswith(end)), name)


def unit_in_file(name: str) -> str:
    """Return the unit of a key of the rig file, or an empty text."""
    ends = sorted((UNITS | OF_FILES).items(), key=lambda end: -len(end[0]))
    return next((unit for end, unit in ends if name.endswith(end)), "")
