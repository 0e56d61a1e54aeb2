"""What a batch of closed loops costs: by substep, on two processes, and as a whole errand."""
