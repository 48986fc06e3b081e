"""Robots in lockstep: the engine, the arbiters that say who drives, and what a rollout leaves.

`episodes` holds the records that go in and come out, `engine` runs B episodes together, and `jobs`
runs many of them, chunk by chunk; `summary` and `traces` are what is kept besides the frames. Read
`rollouts.engine` next.
"""
