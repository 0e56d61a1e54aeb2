"""The buses: one protocol, implemented within one process and over Zenoh."""
