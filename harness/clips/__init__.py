"""Clips: manifests, the names in them, where they stand, and how one is added and checked."""
