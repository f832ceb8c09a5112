"""What ``vfoa bench`` measures, each against a baseline of its own in the same run."""
