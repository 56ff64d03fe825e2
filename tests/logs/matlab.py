"""What the tests make files of MATLAB's of: two arrays, and elements byte by byte."""

import struct

import numpy as np

from butterfly.logs.log import InputKind

KIND = {"input_kind": InputKind.TORQUE}
MATRIX = np.random.default_rng(0).standard_normal((20, 4))
RAMP = np.arange(20.0)
LEVEL5 = b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
"""How a file of level 5 begins."""


def element(kind, data, *, size=None):
    """Return an element with its tag, which tells another size if one is given."""
    told = len(data) if size is None else size
    return struct.pack("<II", kind, told) + data + bytes(-len(data) % 8)


def integers(kind, *values):
    """Return an element of integers of 4 bytes."""
    return element(kind, struct.pack(f"<{len(values)}i", *values))


def array(array_class, shape, *parts, flags=0, count=2):
    """Return an array named D of some class and shape, with its parts."""
    flagged = integers(6, *[array_class | flags, 0, 0][:count])
    body = flagged + integers(5, *shape) + element(1, b"D") + b"".join(parts)
    return element(14, body)


NUMBER = array(6, (1, 1), element(9, bytes(8)))
