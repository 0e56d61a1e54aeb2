"""A lane, from its first tick to its last: floats, flat records and arrays alone; compiled."""
