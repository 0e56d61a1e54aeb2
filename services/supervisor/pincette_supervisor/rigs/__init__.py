"""The rigs that are served: found, watched, and what is known of each."""
