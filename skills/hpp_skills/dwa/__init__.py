"""Point-to-point navigation, classical: the dynamic window approach on the raw scan, without training."""
