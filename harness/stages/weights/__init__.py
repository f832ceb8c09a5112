"""Learned models: the catalogue, downloads, and checks of their files."""
