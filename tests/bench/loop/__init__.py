"""The loop in lockstep beside rings of idle processes: rates, tails, CPU time and their ratios."""
