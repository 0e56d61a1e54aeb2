"""The buses: one protocol, in memory and over Zenoh."""
