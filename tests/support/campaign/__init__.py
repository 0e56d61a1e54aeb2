"""Random rigs brought up and used through the supervisor in virtual time, on an independent plant.

``python -m tests.support.campaign --rigs 200`` prints the table of the documentation.
"""
