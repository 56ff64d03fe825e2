"""Bars of the benchmarks: as they stand with `make bench`, twice as wide with `bench-short`."""

import os

SHORT = bool(os.environ.get("BUTTERFLY_BENCH_SHORT"))
"""Whether fewer draws are made and the bars are twice as wide, for a machine that others share."""

_SLACK = 2.0 if SHORT else 1.0


def at_most(found, bar, what):
    """Fail unless what was found is at most the bar."""
    assert found <= bar * _SLACK, f"{what}: {found:.4g}, at most {bar * _SLACK:.4g} wanted"


def at_least(found, bar, what):
    """Fail unless what was found is at least the bar."""
    assert found >= bar / _SLACK, f"{what}: {found:.4g}, at least {bar / _SLACK:.4g} wanted"
