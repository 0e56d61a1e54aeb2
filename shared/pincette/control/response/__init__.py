"""The free response: where the voltage alone would put the arm, and how that is learnt."""
