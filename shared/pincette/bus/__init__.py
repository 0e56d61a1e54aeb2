"""The buses: one protocol, in one process and over Zenoh."""
