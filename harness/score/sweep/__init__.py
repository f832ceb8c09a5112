"""Sweeps: the recognition rate of thousands of configurations, from percepts that are computed once.

A run saves every frame of every configuration. A sweep saves only counts, since ten thousand configurations would take
gigabytes. To look at one of them, run it by itself: its row has its settings.
"""
