"""Position and force control of piezoelectric microgrippers."""

__version__ = "0.1.0"
is_command = False
"""True in a process of the command line. Such a process uses few models of the REST interface, so
that each model is built only when it is first used."""
