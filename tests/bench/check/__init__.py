"""Whether a measured ratio has become worse than its noise explains."""
