"""MADDPG, the paper's learned baseline."""
