"""CPU time, so that other work on the machine counts for little; in turn, and the least of several.

What is timed in turn meets the same machine: ratios of such times can be trusted.
"""

import os
import sys
import time
from functools import partial

from tests.benchmarks.bars import SHORT, measured


def compare(base, wholes, *, parts=1, **how):
    """Measure, by what it is of, how many times as long as a part of a base each function takes."""
    once, *found = least_seconds(base, *wholes.values(), **how)
    measured({what: parts * each / once for what, each in zip(wholes, found, strict=True)})


def least_seconds(*functions, repeats=2 if SHORT else 7, clock=time.process_time):
    """Return the least time in s of each function, called in turn; of CPUs, unless said otherwise.

    Threads of this process count together.
    """

    def timed(function):
        start = clock()
        function()
        return clock() - start

    return _least([partial(timed, function) for function in functions], repeats)


def least_seconds_of_processes(*programs, repeats=2 if SHORT else 20):
    """Return the least CPU time in s of each program of Python, started in turn."""
    return _least(
        [lambda program=program: of_process(*program)[0] for program in programs], repeats
    )


def of_process(*arguments):
    """Return the CPU time in s and the peak memory in MB of a program of Python."""
    silence = [(os.POSIX_SPAWN_OPEN, fd, os.devnull, os.O_WRONLY, 0) for fd in (1, 2)]
    command = [sys.executable, *map(str, arguments)]
    child = os.posix_spawn(sys.executable, command, os.environ, file_actions=silence)
    _, status, used = os.wait4(child, 0)
    assert os.waitstatus_to_exitcode(status) in {0, 3}, f"{command} failed"
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def _least(functions, repeats):
    """Return the least that each of some functions says it took, and print it for whoever looks."""
    rounds = [[function() for function in functions] for _ in range(repeats)]
    least = [min(each) for each in zip(*rounds, strict=True)]
    print("\nleast times in ms:", ", ".join(f"{1e3 * each:.4g}" for each in least))
    return least
