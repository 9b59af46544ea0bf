"""Predictors: learned motion models of a team, from collecting trajectories to rolling models out."""
