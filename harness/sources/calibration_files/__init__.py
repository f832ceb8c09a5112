"""Readers of calibration files: one module per program that writes them."""
