"""Meta-planners: the search over goals, the paper's planner, its centralised baselines."""
