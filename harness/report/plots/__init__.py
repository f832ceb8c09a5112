"""Figures of a finished run for a paper, one file per kind."""
