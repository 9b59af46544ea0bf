"""Reproducible benchmarks: what ``hpp bench`` runs."""
