"""Bridges to other tools: Gymnasium environments, Minari and LeRobot datasets, your own arrays."""
