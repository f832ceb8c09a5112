"""Learned models: the catalogue, downloads, and whether a file is what it should be."""
