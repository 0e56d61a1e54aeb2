"""DCON protocol, and the host watchdog of a DCON module."""
