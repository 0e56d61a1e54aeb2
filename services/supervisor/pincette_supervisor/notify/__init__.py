"""Tells people and programs elsewhere of ends of jobs and of alarms."""
