"""Estimators: what an agent believes of where its team is."""
