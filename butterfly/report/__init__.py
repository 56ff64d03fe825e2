"""Figures and one-file HTML reports of results."""
