"""Stages that read what was made elsewhere: masks and disparity from files."""
