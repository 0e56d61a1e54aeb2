"""The plant in time: what is measured, put out, played, acquired, and done to it."""
