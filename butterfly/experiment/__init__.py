"""Experiments in YAML, and how to run them."""
