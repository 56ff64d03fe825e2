"""Slips of whoever recorded or described the logs: wrong units, columns, omegas and masses.

A slip is named only where undoing it makes the logs agree with a joint, or with their manifest.
`search` tells cheaply whether to look at all, and tries what `inputs`, `masses` and `trial` offer;
`names` puts it in words.
"""
