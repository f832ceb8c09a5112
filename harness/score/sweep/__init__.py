"""Sweeps: the recognition rate of thousands of configurations, from percepts that are computed once.

A run keeps every frame of every configuration; of a sweep only the counts remain, since ten thousand configurations
would be gigabytes that nobody reads. To look at one of them, run it by itself: its row has its settings.
"""
