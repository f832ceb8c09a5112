"""Runs: experiments in, results and recordings out.

Clips are perceived in :mod:`harness.run.loop`, the only loop over their frames, and attended to in
:mod:`harness.run.attend`.
"""
