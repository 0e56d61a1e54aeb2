"""Plant over time: measurements, outputs, waveforms, captures, and manual actions."""
