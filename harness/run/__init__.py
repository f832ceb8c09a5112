"""Runs: experiments in, results and recordings out. The only loop over frames is in :mod:`harness.run.loop`."""
