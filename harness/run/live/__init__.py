"""Live runs: process the newest frame of a source, and drop those that arrive meanwhile."""
