"""The evaluation harness around :mod:`vfoa`: clips, runs, recordings, scores, reports and the command line."""
