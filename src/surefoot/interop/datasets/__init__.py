"""Datasets of other tools: Minari, LeRobot, and the plain arrays of your own robot or expert."""
