"""Robots in lockstep: the engine, the arbiters that say who drives, and what a rollout leaves.

`episodes` has the records that go in and come out, `engine` runs B episodes together, `jobs` runs
many, chunk by chunk; `summary` and `traces` are what is kept besides the frames. Read `engine`
first.
"""
