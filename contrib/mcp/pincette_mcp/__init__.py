"""Rig as tools of an agent by the Model Context Protocol, over stdio or HTTP."""
