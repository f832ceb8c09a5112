"""Scores: from results and labels to rates, intervals, tests, causes and the oracle ladder."""
