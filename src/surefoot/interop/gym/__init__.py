"""Gymnasium environments, single or in lockstep, and what Stable-Baselines3 wants of them."""
