"""Position and force control of piezoelectric microgrippers."""

__version__ = "0.1.0"
