"""AsyncAPI document of the keys on the bus, generated from their declarations."""
