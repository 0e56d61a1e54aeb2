"""Operating system settings with which a program runs in time."""
