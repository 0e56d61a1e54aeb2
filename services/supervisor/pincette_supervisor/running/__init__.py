"""Jobs at work: taken, watched, ended."""
