"""Readers of calibration files of all programs: YAML and XML, other texts, and files of a single camera."""
