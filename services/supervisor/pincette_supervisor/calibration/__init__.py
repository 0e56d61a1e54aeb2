"""From the samples of a calibration to what they say."""
