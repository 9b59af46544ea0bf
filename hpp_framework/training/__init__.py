"""Skill training: reinforcement learning of goal-conditioned policies."""
