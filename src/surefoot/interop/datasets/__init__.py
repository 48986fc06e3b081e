"""Datasets of other tools: Minari, LeRobot, and plain arrays from your own robot or expert."""
