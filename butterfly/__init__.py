"""Simulate, identify and control the first degree of freedom of the Butterfly robot."""

__version__ = "0.1.0"
