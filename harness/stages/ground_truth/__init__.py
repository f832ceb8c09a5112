"""Stages that return the ground truth, exactly or with an error of known size."""
