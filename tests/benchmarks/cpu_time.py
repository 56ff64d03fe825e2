"""CPU time, so that other work on the machine counts for little; in turn, and the least of several.

What is timed in turn meets the same machine: ratios of such times can be trusted.
"""

import os
import sys
import time

from tests.benchmarks.bars import SHORT


def least_seconds(*functions, repeats=2 if SHORT else 7, clock=time.process_time):
    """Return the least time in s of each function, called in turn; of CPUs, unless said otherwise.

    Threads of this process count together.
    """
    least = [float("inf")] * len(functions)
    for _ in range(repeats):
        for k, function in enumerate(functions):
            start = clock()
            function()
            least[k] = min(least[k], clock() - start)
    return _shown(least)


def least_seconds_of_processes(*programs, repeats=3 if SHORT else 20):
    """Return the least CPU time in s of each program of Python, started in turn."""
    least = [float("inf")] * len(programs)
    silence = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    for _ in range(repeats):
        for k, program in enumerate(programs):
            command = [sys.executable, *program]
            child = os.posix_spawn(sys.executable, command, os.environ, file_actions=silence)
            _, status, used = os.wait4(child, 0)
            assert status == 0
            least[k] = min(least[k], used.ru_utime + used.ru_stime)
    return _shown(least)


def _shown(seconds):
    """Print times for whoever looks on (-s), and return them."""
    print("\nleast times in ms:", ", ".join(f"{1e3 * each:.4g}" for each in seconds))
    return seconds
