"""Plant in time: measurements, outputs, waveforms, captures, and actions on it."""
