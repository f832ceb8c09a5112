"""Stages that know the answer: the truth, and the truth with an error of known size."""
