"""Calibrating a stereo pair from pictures of a board: find corners, solve, write the file that the adapters read."""
