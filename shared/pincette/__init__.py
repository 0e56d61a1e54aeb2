"""Position and force control of piezoelectric microgrippers."""

__version__ = "0.1.0"
is_command = False
"""True in a process of the command line. It needs few of the models of the REST interface, so that
they are built at their first use."""
