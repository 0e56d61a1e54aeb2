"""Jobs: created, queued, run, acted on, ended, and recovered after a crash."""
