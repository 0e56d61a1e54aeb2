"""Parts of a link: ports, recordings, calls."""
