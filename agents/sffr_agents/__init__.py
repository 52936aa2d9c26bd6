"""Agents that learn to schedule the virtual damping; torch and Stable-Baselines3 are imported here alone."""
