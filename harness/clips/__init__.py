"""Clips: manifests, the names in them, their locations, and how a clip is added and checked."""
