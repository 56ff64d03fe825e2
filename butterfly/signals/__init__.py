"""From a log to a frequency response."""
