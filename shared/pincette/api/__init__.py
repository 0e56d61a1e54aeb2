"""What goes over REST: requests, plans, results, problems, and the life of a job as data."""
