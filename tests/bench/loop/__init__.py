"""The loop in lockstep beside rings of do-nothing processes: rates, tails, CPU, their ratios."""
