"""Parts of a link to an instrument: ports, recordings, shared lines."""
