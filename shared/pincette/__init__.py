"""Position and force control of piezoelectric microgrippers."""

__version__ = "0.1.0"
is_command = False
"""True in a command-line process. It uses few models of the REST interface, so each is built at its
first use.
"""
