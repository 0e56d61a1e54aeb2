"""The model in use, its versions, and what calibrations propose."""
