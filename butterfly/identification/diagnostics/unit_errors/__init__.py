"""Slips of whoever recorded or described the logs: wrong units, columns, omegas and masses.

A slip is named only where undoing it makes the logs agree with a joint, or with their manifest.
`suspicion` tells cheaply whether to look at all, `search` tries what `hypotheses` offers, and
`inputs` needs the recorded inputs alone.
"""
