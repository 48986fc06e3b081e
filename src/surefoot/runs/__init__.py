"""A run: its folder, metrics, stages, and what its data cost. Read `runs.run` first."""
