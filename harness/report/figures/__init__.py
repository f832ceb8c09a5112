"""Figures of runs for a paper: each as SVG and PDF, one and two columns wide. Needs the extra ``vfoa[figures]``."""
