"""Calibrations as people have them: one module per program that writes them."""
