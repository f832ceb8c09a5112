"""Figures of a finished run that print in a paper, one file per kind."""
