"""Watches a rig: its checks, and the alarms that follow from them."""
