"""Clips without images: people and objects in metres, measured by other programs."""
