"""Distil a model predictive controller into a 1 kHz neural policy for a legged robot, safely."""
