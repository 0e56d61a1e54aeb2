"""The recorder as a program: it keeps every sample of every job, and is never in the loop."""
