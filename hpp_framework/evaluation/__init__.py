"""Evaluation: episodes, metrics, statistics, pictures."""
