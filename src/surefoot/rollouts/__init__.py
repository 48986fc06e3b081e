"""Rollouts of robots in lockstep: the engine, the arbiters that say who drives, the results.

`episodes` holds the records that go in and come out, `engine` runs B episodes together, and `jobs`
runs many of them, chunk by chunk; `summary` and `traces` are kept in addition to the frames. Read
`rollouts.engine` next.
"""
