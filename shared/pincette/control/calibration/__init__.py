"""Calibration: mode, compliance and contact from measurements, with their uncertainties."""
