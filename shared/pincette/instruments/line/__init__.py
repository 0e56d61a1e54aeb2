"""What a link is made of: ports, recordings, calls."""
