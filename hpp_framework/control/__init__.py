"""What stands between a skill and the wheels."""
