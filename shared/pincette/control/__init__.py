"""Pure mathematics: no input or output, no clock, no message, no global state.

Units are µm, mN, V and s throughout; stiffness is mN/µm, mass mN·s²/µm, damping mN·s/µm.
"""
