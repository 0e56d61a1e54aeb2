"""The DCON protocol, and a module's host watchdog."""
