"""Robots in lockstep: the engine, who drives, what a rollout leaves."""
