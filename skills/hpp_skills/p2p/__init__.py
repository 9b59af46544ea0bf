"""Point-to-point navigation, learned: a small convolutional policy over the raw scan."""
