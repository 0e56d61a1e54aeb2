"""The contact force: found from position and free response, zeroed, and how far to trust it."""
