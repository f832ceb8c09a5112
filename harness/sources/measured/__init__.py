"""Clips without images: people and objects in metres, measured elsewhere."""
