"""The one loop: a batch of episodes of a team, stepped, sensed and judged."""
