"""Robots: their models, shapes and rigid-body motion."""
