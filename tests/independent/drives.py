"""Torques as functions of (n,) stamps in s, each with its amplitude; clocks; random sizes."""

import math

import numpy as np


def log_uniform(rng, low, high, size=None):
    """Draw evenly over decades."""
    return np.exp(rng.uniform(math.log(low), math.log(high), size))


def clock(rng, duration, step, jitter):
    """Stamps of cycles whose lengths have a standard deviation of ``jitter`` of their mean."""
    cycles = step * (1.0 + jitter * rng.standard_normal(round(duration / step)))
    return np.concatenate([[0.0], np.cumsum(np.maximum(cycles, 0.1 * step))])


def sine(size, omega):
    """Return a sine."""
    return lambda time: size * np.sin(omega * time)


def multisine(pace, size, rng):
    """Six sines about an angular frequency, ``size`` together as far as phases are random."""
    omegas = pace * log_uniform(rng, 0.4, 2.2, 6)
    phases = rng.uniform(0.0, 2.0 * np.pi, 6)
    each = size / math.sqrt(phases.size)

    def torque(time):
        return each * np.sin(np.outer(time, omegas) + phases).sum(axis=1)

    return torque, each * phases.size


def chirp(pace, size, rng):
    """Sweep over an angular frequency."""
    first, last = pace * rng.uniform(0.3, 0.7), pace * rng.uniform(1.5, 2.5)

    def torque(time):
        rate = (last - first) / time[-1]
        return size * np.sin(first * time + 0.5 * rate * time**2)

    return torque, size


def steps(pace, size, rng):
    """Levels of random length, a fifth of a period to one."""
    lengths = rng.uniform(0.2, 1.0, 200) * 2.0 * np.pi / pace
    levels = rng.uniform(-1.0, 1.0, lengths.size) * size
    levels[::2] *= -np.sign(levels[::2] * levels[1::2])  # neighbours pull against each other
    ends = np.cumsum(lengths)

    def torque(time):
        return levels[np.searchsorted(ends, time, "right") % levels.size]

    return torque, size


def stairs(pace, size, rng):
    """Levels of one sign, as somebody makes them who turns a knob up and down."""
    torque, most = steps(pace, rng.uniform(0.5, 1.0) * size, rng)
    sign = float(rng.choice([-1.0, 1.0]))
    return lambda time: sign * np.abs(torque(time)), most


def still(_, size, rng):  # noqa: ARG001 - as its neighbours
    """Return no torque at all."""
    return np.zeros_like, size
