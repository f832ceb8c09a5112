"""Scores: from results and labels to rates, intervals, tests, error types and the oracle ablation."""
