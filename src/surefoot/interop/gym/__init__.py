"""Gymnasium environments, single or in lockstep, and an adapter for Stable-Baselines3."""
