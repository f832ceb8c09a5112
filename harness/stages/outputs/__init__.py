"""Stages that read outputs of other programs from files."""
