"""Hierarchical predictive planning, the paper's and a better one."""
